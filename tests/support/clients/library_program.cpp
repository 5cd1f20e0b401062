// Queries a scene of one part through the header for C++.
#include <cmath>
#include <cstdio>
#include <proximity.hpp>
int main(int, char **words)
try {
    proximity::Scene opened(words[1]), scene = std::move(opened);
    std::array<proximity::Vector, 2> points{{{0.03, 0.01, 0.005}, {0.03, 0.01, 0.002}}};
    std::array<proximity::Vector, 2> up{{{0.0, 0.0, 1.0}, {0.0, 0.0, 1.0}}};
    std::array<proximity::ClosestPoint, 2> found;
    std::array<proximity::RayHit, 2> hits;
    std::array<proximity::SegmentHit, 2> nearest;
    std::array<double, 2> distances;
    std::array<std::uint8_t, 2> inside;
    scene.move(scene.find("bracket"), scene.pose(0));
    std::array<std::int32_t, 1> parts{scene.part("bracket")};
    std::array<proximity::Matrix, 1> poses{scene.pose(0)};
    scene.move(parts, poses);
    scene.move(parts, poses, std::span<const proximity::Vector>(up).first(1));
    scene.move(parts, poses, {}, {});
    scene.post(0, scene.pose(0), 0, &up[0], &up[1]);
    scene.take(1000000);
    if (std::abs(scene.pose(0)[11] - poses[0][11] - 0.001) > 1e-15)
        std::printf("a posted part is not moved on\n");
    scene.post(0, poses[0], 0);
    scene.take(0);
    scene.use_instructions(scene.instructions());
    scene.set_surface(0, 700.0, 0.5);
    scene.closest(points, found);
    scene.cast(points, up, hits);
    scene.closest_to_segments(points, up, nearest);
    scene.signed_distance(points, distances);
    scene.contains(points, inside);
    std::array<std::int64_t, 2> instants{1000000000, 1000000000};
    proximity::Tracker tracker(scene, 2);
    tracker.set_radius(1, 0.007);
    std::array<proximity::Vector, 2> still{};
    tracker.tick(points, instants, 1000000500, nullptr, still);
    tracker.reset();
    auto contacts = tracker.tick(points, instants, 1000000500);
    for (int k = 0; k < 2; k++)
        std::printf("%s %.6g %.6g %d %.6g %.6g %.6g\n", scene.name(found[k].part).c_str(),
                    found[k].signed_distance, distances[k], inside[k], hits[k].distance, nearest[k].distance,
                    contacts[k].signed_distance);
    std::array<double, 2> along;
    scene.cast_distance(points, up, along);
    if (along[0] != hits[0].distance || scene.is_hidden(0) || scene.face_count(0) == 0)
        std::printf("answers differ\n");
    scene.closest(points, found, proximity::unlimited, parts);
    scene.cast(points, up, hits, proximity::unlimited, parts);
    scene.closest_to_segments(points, up, nearest, proximity::unlimited, parts);
    scene.contains(points, inside, parts);
    if (found[1].part != PROXIMITY_NO_PART || hits[0].part != PROXIMITY_NO_PART || std::isfinite(nearest[0].distance) || inside[1])
        std::printf("an ignored part answers\n");
    for (int k = 0; k < 3; k++) {
        k == 0   ? scene.distance(points, along, parts)
        : k == 1 ? scene.signed_distance(points, along, parts)
                 : scene.cast_distance(points, up, along, proximity::unlimited, parts);
        if (std::isfinite(along[0]))
            std::printf("an ignored part answers\n");
    }
    tracker.ignore(0, 0);
    contacts = tracker.tick(points, instants, 1000000500);
    if (std::isfinite(contacts[0].lower) || !std::isfinite(contacts[1].lower))
        std::printf("an ignored part answers\n");
    tracker.ignore(0, 0, false);
    contacts = tracker.tick(points, instants, 1000000500);
    try {
        scene.clearance("bracket", "nothing");
    } catch (const proximity::Error &error) {
        std::printf("%s\n", error.what());
    }
    try {
        opened.signed_distance(points, distances);
    } catch (const proximity::Error &error) {
        std::printf("%s\n", error.what());
    }
    std::array<double, 2> before{contacts[0].signed_distance, contacts[1].signed_distance};
    proximity::Scene pairs(words[1]);
    pairs.add("plate", std::array<proximity::Vector, 3>{{{0.0, 0.0, 1.0}, {1.0, 0.0, 1.0}, {0.0, 1.0, 1.0}}},
              std::array<proximity::Triangle, 1>{{{0, 1, 2}}});
    const auto near = pairs.closest_pairs();
    proximity::PartTracker part(pairs, "plate");
    const double far = part.tick(pairs.pose(1), 0, 0)[0].distance, same = part.tick(0, 0)[0].distance;
    if (near.size() != 1 || near[0].clearance.distance != far || far != same || pairs.penetration(0, 1).depth != 0.0)
        std::printf("pairs differ\n");
    { proximity::Scene gone = std::move(scene); }
    contacts = tracker.tick(points, instants, 1000000500);
    if (before[0] != contacts[0].signed_distance || before[1] != contacts[1].signed_distance)
        std::printf("a tracker has forgotten its scene\n");
    proximity::Scene noting(words[1]);
    noting.set_log([](void *, const char *sentence) { std::printf("%s\n", sentence); });
    points[0][2] = 40.0;
    noting.signed_distance(std::span<const proximity::Vector>(points).first(1), std::span<double>(distances).first(1));
    proximity::Scene none("none.prox");
} catch (const proximity::Error &error) {
    std::printf("%d %s\n", static_cast<int>(error.code), error.what());
}
