// proximity for C++20: scenes and trackers that close themselves, with spans and exceptions. With -fno-exceptions
// errors are kept as proximity::status(). See proximity.h.
#ifndef PROXIMITY_HPP
#define PROXIMITY_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "proximity_tracker.h"

namespace proximity {

using Vector = std::array<double, 3>;
using Triangle = std::array<std::int32_t, 3>;  // rows of vertices
using Matrix = std::array<double, 16>;  // row by row, scene from part
using ClosestPoint = proximity_closest_point;
using RayHit = proximity_ray_hit;
using SegmentHit = proximity_segment_hit;
using Clearance = proximity_clearance_answer;
using Penetration = proximity_penetration_answer;
using Connection = proximity_connection;
/// Two parts, the lower number first, and their clearance.
struct Pair {
    std::int32_t first, second;
    Clearance clearance;
};

inline constexpr double unlimited = std::numeric_limits<double>::infinity();

/// An error, with a sentence that gives the expectation; `code` is one of PROXIMITY_...
class Error : public std::runtime_error {
public:
    Error(std::int32_t number, const std::string &sentence) : std::runtime_error(sentence), code(number) {}
    const std::int32_t code;
};

#if !defined(__cpp_exceptions)
/// The last error of this thread, in programs without exceptions: check `code` after a call, and set it to
/// PROXIMITY_OK. A call that fails writes no output; a scene or a tracker that cannot be made is empty.
inline proximity_error &status()
{
    static thread_local proximity_error last{};
    return last;
}
#endif

namespace detail {

/// Throw an error, or store it as the status without exceptions.
inline void fail(std::int32_t code, const char *sentence)
{
#if defined(__cpp_exceptions)
    throw Error(code, sentence);
#else
    status().code = code;
    std::snprintf(status().sentence, sizeof status().sentence, "%s", sentence);
#endif
}

/// Call a function of the library; return whether it succeeded.
template <typename Function, typename... Arguments>
bool call(Function function, Arguments... arguments)
{
    proximity_error error;
    const bool is_done = function(arguments..., &error) == PROXIMITY_OK;
    if (!is_done) {
        fail(error.code, error.sentence);
    }
    return is_done;
}

inline const double *numbers(std::span<const Vector> rows)
{
    return rows.empty() ? nullptr : rows.front().data();
}

/// Return whether spans have equal numbers of rows; otherwise an error is set.
inline bool same(std::size_t one, std::size_t other)
{
    if (one != other) {
        fail(PROXIMITY_BAD_ARGUMENT, "spans have different numbers of rows");
    }
    return one == other;
}

/// Return whether the library matches this header; otherwise an error is set.
inline bool has_interface()
{
    if (proximity_interface() != PROXIMITY_INTERFACE) {
        fail(PROXIMITY_BAD_ARGUMENT, "the library has another interface than this header: take both from one version");
    }
    return proximity_interface() == PROXIMITY_INTERFACE;
}

}  // namespace detail

/// A scene: a compiled one, or parts that are added. Const members may run in any number of threads; the others change.
class Scene {
public:
    /// An empty scene: add parts before the first query.
    Scene()
    {
        if (detail::has_interface()) {
            detail::call(proximity_new_scene, address());
        }
    }
    /// The bodies of a mesh, m, with faces that are counter-clockwise seen from outside; see proximity_from_mesh.
    Scene(const std::string &name, std::span<const Vector> vertices, std::span<const Triangle> faces)
    {
        if (detail::has_interface()) {
            detail::call(proximity_from_mesh, name.c_str(), detail::numbers(vertices), vertices.size(),
                         faces.empty() ? nullptr : faces.front().data(), faces.size(), address());
        }
    }
    explicit Scene(const std::string &path)
    {
        if (detail::has_interface()) {
            detail::call(proximity_open, path.c_str(), address());
        }
    }
    /// The caller owns the bytes, at a multiple of 8, until the scene and its trackers are destroyed.
    explicit Scene(std::span<const std::byte> bytes)
    {
        if (detail::has_interface()) {
            detail::call(proximity_open_bytes, static_cast<const void *>(bytes.data()), bytes.size(), address());
        }
    }
    Scene(Scene &&other) noexcept : scene_(std::exchange(other.scene_, nullptr)) {}
    Scene &operator=(Scene &&other) noexcept
    {
        std::swap(scene_, other.scene_);
        return *this;
    }
    ~Scene() { proximity_close(scene_); }

    const proximity_scene *get() const { return scene_; }
    proximity_scene *get() { return scene_; }
    /// Pass on notes on suspicious input, see proximity.h; without arguments, none.
    void set_log(proximity_log *log = nullptr, void *user = nullptr) { proximity_set_log(scene_, log, user); }
    std::int32_t part_count() const { return proximity_part_count(scene_); }
    std::int32_t find(const std::string &name) const { return proximity_find_part(scene_, name.c_str()); }
    /// The number of a part by name; an Error if there is none.
    std::int32_t part(const std::string &name) const
    {
        const std::int32_t found = find(name);
        if (found == PROXIMITY_NO_PART) {
            detail::fail(PROXIMITY_BAD_ARGUMENT, ("there is no part named '" + name + "'").c_str());
        }
        return found;
    }
    std::string name(std::int32_t part) const
    {
        const char *found = proximity_part_name(scene_, part);
        return found != nullptr ? found : "";
    }
    Matrix pose(std::int32_t part) const
    {
        Matrix matrix{};
        detail::call(proximity_pose, get(), part, matrix.data());
        return matrix;
    }
    std::int32_t face_count(std::int32_t part) const { return proximity_face_count(scene_, part); }
    bool is_hidden(std::int32_t part) const { return proximity_is_hidden(scene_, part) != 0; }
    std::string instructions() const
    {
        const char *found = proximity_instructions(scene_);
        return found != nullptr ? found : "";
    }
    void use_instructions(const std::string &name)
    {
        detail::call(proximity_use_instructions, scene_, name.c_str());
    }
    std::array<Vector, 2> bounds() const
    {
        std::array<Vector, 2> corners;
        proximity_bounds(scene_, corners[0].data(), corners[1].data());
        return corners;
    }

    /// Add copies of the parts of another scene, at a pose times their own; the number of the first.
    std::int32_t add(const Scene &added, const Matrix *pose = nullptr)
    {
        std::int32_t first = PROXIMITY_NO_PART;
        detail::call(proximity_add_scene, scene_, added.get(), pose != nullptr ? pose->data() : nullptr, &first);
        return first;
    }
    /// Add a mesh; the number of its part, or of the first of its bodies.
    std::int32_t add(const std::string &name, std::span<const Vector> vertices, std::span<const Triangle> faces,
                     const Matrix *pose = nullptr)
    {
        return add(Scene(name, vertices, faces), pose);
    }
    /// The reason for the sign method of a part from a mesh; empty for parts of a compiled scene.
    std::string sign_reason(std::int32_t part) const
    {
        const char *found = proximity_sign_reason(scene_, part);
        return found != nullptr ? found : "";
    }
    /// Remove a part; the numbers of later parts decrease by one.
    void remove(std::int32_t part) { detail::call(proximity_remove, scene_, part); }

    void move(std::int32_t part, const Matrix &pose, const Vector *velocity = nullptr,
              const Vector *angular_velocity = nullptr)
    {
        detail::call(proximity_move, scene_, static_cast<const std::int32_t *>(&part), std::size_t{1}, pose.data(),
                     velocity != nullptr ? velocity->data() : nullptr,
                     angular_velocity != nullptr ? angular_velocity->data() : nullptr);
    }
    /// Move several parts together: all of them or, if one cannot be moved, none. Without velocities they are at rest.
    void move(std::span<const std::int32_t> parts, std::span<const Matrix> poses,
              std::span<const Vector> velocities = {}, std::span<const Vector> angular_velocities = {})
    {
        if (!(detail::same(parts.size(), poses.size()) &&
              (velocities.empty() || detail::same(velocities.size(), parts.size())) &&
              (angular_velocities.empty() || detail::same(angular_velocities.size(), parts.size())))) {
            return;
        }
        detail::call(proximity_move, scene_, parts.data(), parts.size(),
                     poses.empty() ? nullptr : static_cast<const double *>(poses.front().data()),
                     detail::numbers(velocities),
                     detail::numbers(angular_velocities));
    }
    /// Post the pose of a part from another thread than the one that ticks; see proximity_post.
    void post(std::int32_t part, const Matrix &pose, std::int64_t pose_ns, const Vector *velocity = nullptr,
              const Vector *angular_velocity = nullptr)
    {
        detail::call(proximity_post, scene_, part, pose.data(), pose_ns,
                     velocity != nullptr ? velocity->data() : nullptr,
                     angular_velocity != nullptr ? angular_velocity->data() : nullptr);
    }
    /// Apply posted poses for an instant, in programs without a tracker.
    void take(std::int64_t instant_ns)
    {
        detail::call(proximity_take, scene_, instant_ns);
    }
    /// N/m and N s/m; 0: the part is rigid.
    void set_surface(std::int32_t part, double stiffness, double damping = 0.0)
    {
        detail::call(proximity_set_surface, scene_, part, stiffness, damping);
    }
    void hide(std::int32_t part, bool is_hidden = true) { detail::call(proximity_hide, scene_, part, int{is_hidden}); }

    // Queries; `ignored`: numbers of parts that one leaves out, see proximity_closest_without.
    void closest(std::span<const Vector> points, std::span<ClosestPoint> answers, double limit = unlimited,
                 std::span<const std::int32_t> ignored = {}) const
    {
        if (!detail::same(points.size(), answers.size())) {
            return;
        }
        detail::call(proximity_closest_without, get(), detail::numbers(points), points.size(), limit, ignored.data(),
                     ignored.size(), answers.data());
    }
    void signed_distance(std::span<const Vector> points, std::span<double> distances,
                         std::span<const std::int32_t> ignored = {}) const
    {
        if (!detail::same(points.size(), distances.size())) {
            return;
        }
        detail::call(proximity_signed_distance_without, get(), detail::numbers(points), points.size(), ignored.data(),
                     ignored.size(), distances.data());
    }
    void distance(std::span<const Vector> points, std::span<double> distances,
                  std::span<const std::int32_t> ignored = {}) const
    {
        if (!detail::same(points.size(), distances.size())) {
            return;
        }
        detail::call(proximity_distance_without, get(), detail::numbers(points), points.size(), ignored.data(),
                     ignored.size(), distances.data());
    }
    void contains(std::span<const Vector> points, std::span<std::uint8_t> is_inside,
                  std::span<const std::int32_t> ignored = {}) const
    {
        if (!detail::same(points.size(), is_inside.size())) {
            return;
        }
        detail::call(proximity_contains_without, get(), detail::numbers(points), points.size(), ignored.data(),
                     ignored.size(), is_inside.data());
    }
    void cast(std::span<const Vector> origins, std::span<const Vector> directions, std::span<RayHit> answers,
              double limit = unlimited, std::span<const std::int32_t> ignored = {}) const
    {
        if (!(detail::same(origins.size(), directions.size()) &&
              detail::same(origins.size(), answers.size()))) {
            return;
        }
        detail::call(proximity_cast_without, get(), detail::numbers(origins), detail::numbers(directions),
                     origins.size(), limit, ignored.data(), ignored.size(), answers.data());
    }
    void cast_distance(std::span<const Vector> origins, std::span<const Vector> directions, std::span<double> distances,
                       double limit = unlimited, std::span<const std::int32_t> ignored = {}) const
    {
        if (!(detail::same(origins.size(), directions.size()) &&
              detail::same(origins.size(), distances.size()))) {
            return;
        }
        detail::call(proximity_cast_distance_without, get(), detail::numbers(origins), detail::numbers(directions),
                     origins.size(), limit, ignored.data(), ignored.size(), distances.data());
    }
    void closest_to_segments(std::span<const Vector> starts, std::span<const Vector> ends,
                             std::span<SegmentHit> answers, double limit = unlimited,
                             std::span<const std::int32_t> ignored = {}) const
    {
        if (!(detail::same(starts.size(), ends.size()) &&
              detail::same(starts.size(), answers.size()))) {
            return;
        }
        detail::call(proximity_closest_to_segments_without, get(), detail::numbers(starts), detail::numbers(ends),
                     starts.size(), limit, ignored.data(), ignored.size(), answers.data());
    }
    Clearance clearance(std::int32_t first, std::int32_t second, double limit = unlimited, double tolerance = 0.0,
                        std::size_t budget = 0) const
    {
        Clearance answer{};
        detail::call(proximity_clearance, get(), first, second, limit, tolerance, budget, &answer);
        return answer;
    }
    Clearance clearance(const std::string &first, const std::string &second, double limit = unlimited,
                        double tolerance = 0.0, std::size_t budget = 0) const
    {
        return clearance(part(first), part(second), limit, tolerance, budget);
    }
    /// The nearest pairs of visible parts, or of one part and others, the nearest first; at most so many.
    std::vector<Pair> closest_pairs(double limit = unlimited, std::size_t most = SIZE_MAX,
                                    std::int32_t of = PROXIMITY_NO_PART) const
    {
        const auto others = static_cast<std::size_t>(part_count() > 0 ? part_count() - 1 : 0);
        std::size_t count = of != PROXIMITY_NO_PART ? others : others * (others + 1) / 2;
        count = most < count ? most : count;
        std::vector<std::int32_t> parts(2 * count);
        std::vector<Clearance> answers(count);
        std::vector<Pair> pairs;
        if (detail::call(proximity_closest_pairs, get(), of, limit, count, parts.data(), answers.data(), &count)) {
            pairs.reserve(count);
            for (std::size_t k = 0; k < count; k++) {
                pairs.push_back({parts[2 * k], parts[2 * k + 1], answers[k]});
            }
        }
        return pairs;
    }
    /// How deep two parts are in each other; without a direction, along one with a short way out.
    Penetration penetration(std::int32_t first, std::int32_t second, const Vector *direction = nullptr,
                            double tolerance = 0.01) const
    {
        Penetration answer{};
        detail::call(proximity_penetration, get(), first, second, direction != nullptr ? direction->data() : nullptr,
                     tolerance, &answer);
        return answer;
    }

private:
    proximity_scene **address() { return &scene_; }
    proximity_scene *scene_ = nullptr;
};

/// A tracker of fingertips. It keeps the required data of its scene, which may be destroyed first.
class Tracker {
public:
    explicit Tracker(const Scene &scene, std::size_t fingers = 5,
                     const proximity_tracker_settings &settings = proximity_default_settings())
        : contacts_(fingers)
    {
        proximity_tracker *made = nullptr;
        detail::call(proximity_create_tracker, scene.get(), fingers, &settings, &made);
        tracker_.reset(made);
    }

    /// The contacts of all fingers, overwritten by the next tick; none if it fails. Without velocities these are
    /// estimated.
    std::span<const proximity_contact> tick(std::span<const Vector> positions, std::span<const std::int64_t> pose_ns,
                                            std::int64_t now_ns, const proximity_paths *paths = nullptr,
                                            std::span<const Vector> velocities = {})
    {
        const bool is_done =
            detail::same(positions.size(), contacts_.size()) && detail::same(pose_ns.size(), contacts_.size()) &&
            (velocities.empty() || detail::same(velocities.size(), contacts_.size())) &&
            detail::call(proximity_tick, tracker_.get(), detail::numbers(positions), pose_ns.data(), now_ns,
                         detail::numbers(velocities), paths, contacts_.data());
        return {contacts_.data(), is_done ? contacts_.size() : 0};
    }
    /// Have a finger ignore a part, or heed it again, from the next tick on; see proximity_ignore.
    void ignore(std::size_t finger, std::int32_t part, bool is_ignored = true)
    {
        detail::call(proximity_ignore, tracker_.get(), finger, part, int{is_ignored});
    }
    /// m, of one fingertip.
    void set_radius(std::size_t finger, double radius)
    {
        detail::call(proximity_set_radius, tracker_.get(), finger, radius);
    }
    void reset() { proximity_reset_tracker(tracker_.get()); }

private:
    struct Destroy {
        void operator()(proximity_tracker *tracker) const { proximity_destroy_tracker(tracker); }
    };
    std::unique_ptr<proximity_tracker, Destroy> tracker_;
    std::vector<proximity_contact> contacts_;
};

/// The nearest connections of a part that moves, or of several that move together, to the rest of a scene. It keeps the
/// required data of its scene, which may be destroyed first.
class PartTracker {
public:
    PartTracker(Scene &scene, std::span<const std::int32_t> parts, std::size_t connections = 1,
                const proximity_part_tracker_settings &settings = proximity_default_part_settings())
        : connections_(connections)
    {
        proximity_part_tracker *made = nullptr;
        detail::call(proximity_create_part_tracker, scene.get(), parts.data(), parts.size(), connections, &settings, &made);
        tracker_.reset(made);
    }
    PartTracker(Scene &scene, const std::string &part, std::size_t connections = 1,
                const proximity_part_tracker_settings &settings = proximity_default_part_settings())
        : PartTracker(scene, std::array{scene.part(part)}, connections, settings)
    {
    }

    /// Move the part; the connections, the shortest first, are overwritten by the next tick; none if it fails. Velocities
    /// that are nullptr follow from the last two poses.
    std::span<const Connection> tick(const Matrix &pose, std::int64_t pose_ns, std::int64_t now_ns,
                                     const Vector *velocity = nullptr, const Vector *angular_velocity = nullptr)
    {
        return tick(pose.data(), pose_ns, now_ns, velocity, angular_velocity);
    }
    /// The same for parts that the scene moves.
    std::span<const Connection> tick(std::int64_t pose_ns, std::int64_t now_ns)
    {
        return tick(static_cast<const double *>(nullptr), pose_ns, now_ns, nullptr, nullptr);
    }
    void reset() { proximity_reset_part_tracker(tracker_.get()); }

private:
    std::span<const Connection> tick(const double *pose, std::int64_t pose_ns, std::int64_t now_ns, const Vector *velocity,
                                     const Vector *angular_velocity)
    {
        const bool is_done = detail::call(proximity_tick_part, tracker_.get(), pose, pose_ns, now_ns,
                                          velocity != nullptr ? velocity->data() : nullptr,
                                          angular_velocity != nullptr ? angular_velocity->data() : nullptr,
                                          connections_.data());
        return {connections_.data(), is_done ? connections_.size() : 0};
    }
    struct Destroy {
        void operator()(proximity_part_tracker *tracker) const { proximity_destroy_part_tracker(tracker); }
    };
    std::unique_ptr<proximity_part_tracker, Destroy> tracker_;
    std::vector<Connection> connections_;
};

}  // namespace proximity

#endif
