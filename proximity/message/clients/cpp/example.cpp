// example.cpp: a fingertip that comes down on the scene, and what the service says of it.
//
//   g++ -std=c++20 -O2 -Wall example.cpp -o example        (Windows: x86_64-w64-mingw32-g++ ... -lws2_32)
//   ./example FRAMES_PORT POSES_PORT SECONDS [KEY]
//
// The scene file has `publish = ["udp://127.0.0.1:FRAMES_PORT"]` in [service] and
// `poses = "udp://127.0.0.1:POSES_PORT"` in [input], both with `?key=KEY` where there is one.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "decaff_client.hpp"

static const char *const names[] = {"STARTING", "OK", "DEGRADED", "LATE", "STALE", "STOPPING"};

static void show(const decaff::reading &now)
{
    std::printf("%s age %.1f ms", names[now.state], 1e-6 * static_cast<double>(now.age_ns));
    for (const decaff_contact &contact : now.contacts) {
        if ((contact.flags & DECAFF_FLAG_TRACKED) == 0)
            continue; // nothing is known of it: take the hand's force away
        // While the frame is valid the distance holds; LATE, only that it is at least the lower bound.
        std::printf("; finger %u: %s %.3f mm", static_cast<unsigned>(contact.finger),
                    now.is_valid() ? "at" : "at least", 1e3 * contact.lower);
    }
    std::printf("\n");
}

int main(int count, char **words)
{
    if (count < 4) {
        std::fprintf(stderr, "example: expected FRAMES_PORT POSES_PORT SECONDS [KEY]\n");
        return 2;
    }
    try {
        const std::string key = count > 4 ? words[4] : "";
        decaff::receiver frames({.port = static_cast<std::uint16_t>(std::atoi(words[1])), .key = key});
        decaff::sender poses({.port = static_cast<std::uint16_t>(std::atoi(words[2])), .key = key});
        const auto began = std::chrono::steady_clock::now();
        const std::chrono::duration<double> lasts(std::atof(words[3]));
        for (auto gone = lasts * 0; gone < lasts; gone = std::chrono::steady_clock::now() - began) {
            // From 60 mm above the origin's corner down to 40 mm, at 5 mm a second.
            const double tip[3] = {0.030, 0.010, std::max(0.060 - 0.005 * gone.count(), 0.040)};
            const std::vector<decaff_pose> hand = {decaff::pose_of(0, tip)};
            poses.send(hand);
            show(frames.wait(std::chrono::milliseconds(10))); // a picture's worth of time
        }
        const decaff::counts &seen = frames.counted();
        std::printf("received %llu, lost %llu\n", static_cast<unsigned long long>(seen.received),
                    static_cast<unsigned long long>(seen.lost));
    } catch (const decaff::error &failure) {
        std::fprintf(stderr, "example: %s\n", failure.what());
        return 1;
    }
}
