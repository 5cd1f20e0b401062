// A part that the user imports while fingers are tracked: imported PART.stl (binary, in mm). A thread builds the part,
// another moves it at 90 Hz, and this one ticks ten fingers at 1 kHz.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <future>
#include <iterator>
#include <proximity.hpp>
#include <thread>

using Clock = std::chrono::steady_clock;

static std::int64_t now_ns() { return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count(); }

static proximity::Scene import_stl(const char *path)
{
    std::ifstream file(path, std::ios::binary);
    const std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
    std::vector<proximity::Vector> vertices;
    std::vector<proximity::Triangle> faces;
    for (std::size_t at = 84; at + 50 <= bytes.size(); at += 50) { // header; then normal, corners, two bytes a face
        float corners[9];
        std::memcpy(corners, &bytes[at + 12], sizeof corners);
        const auto first = static_cast<std::int32_t>(vertices.size());
        for (int k = 0; k < 9; k += 3)
            vertices.push_back({0.001 * corners[k], 0.001 * corners[k + 1], 0.001 * corners[k + 2]});
        faces.push_back({first, first + 1, first + 2});
    }
    return proximity::Scene("imported", vertices, faces);
}

int main(int count, char **words)
try {
    if (count != 2)
        throw proximity::Error(PROXIMITY_BAD_ARGUMENT, "expected a file of STL");
    const std::array<proximity::Vector, 3> corners{{{-1, -1, -0.2}, {1, -1, -0.2}, {0, 1, -0.2}}};
    const std::array<proximity::Triangle, 1> face{{{0, 1, 2}}};
    proximity::Scene scene;
    scene.add("floor", corners, face);
    proximity::Tracker tracker(scene, 10);
    std::vector<proximity::Vector> tips(10);
    for (std::size_t k = 0; k < tips.size(); k++)
        tips[k] = {0.01 * static_cast<double>(k), 0.0, 0.05};

    std::future<proximity::Scene> import = std::async(std::launch::async, import_stl, words[1]);
    std::int32_t part = PROXIMITY_NO_PART;
    std::jthread mover;
    double nearest = proximity::unlimited;
    auto next = Clock::now();
    for (int ticks_left = 1000; ticks_left > 0; std::this_thread::sleep_until(next += std::chrono::milliseconds(1))) {
        if (part == PROXIMITY_NO_PART && import.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
            part = scene.add(import.get()); // between two ticks; the tracker keeps its state
            mover = std::jthread([&](std::stop_token stop) {
                for (int k = 0; !stop.stop_requested(); k++, std::this_thread::sleep_for(std::chrono::microseconds(11111))) {
                    const double angle = 0.05 * k;
                    scene.post(part, {std::cos(angle), -std::sin(angle), 0, 0, std::sin(angle), std::cos(angle), 0, 0,
                                      0, 0, 1, 0, 0, 0, 0, 1}, now_ns());
                }
            });
        }
        ticks_left -= part != PROXIMITY_NO_PART;
        const std::vector<std::int64_t> instants(10, now_ns());
        for (const proximity_contact &contact : tracker.tick(tips, instants, instants[0]))
            if (contact.part == part && part != PROXIMITY_NO_PART)
                nearest = std::fmin(nearest, contact.signed_distance);
    }
    mover.request_stop();
    mover.join();
    scene.remove(part);
    std::printf("came within %.3f mm of '%s', now %d part\n", 1e3 * nearest, "imported", scene.part_count());
} catch (const proximity::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
