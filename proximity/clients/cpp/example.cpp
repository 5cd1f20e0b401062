// example.cpp: a fingertip that descends on the sample bracket, and the service's answers.
//
//   g++ -std=c++20 -O2 -Wall example.cpp -o example        (Windows: x86_64-w64-mingw32-g++ ... -lws2_32)
//   ./example FRAMES_PORT POSES_PORT SECONDS [KEY]
//
// The scene file has `publish = ["udp://127.0.0.1:FRAMES_PORT"]` in [service] and
// `poses = "udp://127.0.0.1:POSES_PORT"` in [input], both with `?key=KEY` if there is one.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include "proximity_client.hpp"

static const char *const names[] = {"STARTING", "OK", "DEGRADED", "LATE", "STALE", "STOPPING"};

static void show(const proximity::reading &now)
{
    if (now.header == nullptr) {
        std::printf("no frame yet\n");
        return;
    }
    std::printf("%s", names[now.state]);
    for (const proximity_contact &contact : now.contacts) {
        if ((contact.flags & PROXIMITY_FLAG_TRACKED) == 0)
            continue; // unknown: remove the hand's force
        // While the frame is valid the distance holds; LATE, only that it is at least the lower bound.
        std::printf("; finger %u: %s %.3f mm, pose %.1f ms old", static_cast<unsigned>(contact.finger),
                    now.is_valid() ? "at" : "at least", 1e3 * contact.lower, 1e-6 * static_cast<double>(contact.age_ns));
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
        proximity::receiver frames({.port = static_cast<std::uint16_t>(std::atoi(words[1])), .key = key});
        proximity::sender poses({.port = static_cast<std::uint16_t>(std::atoi(words[2])), .key = key});
        const int pictures = static_cast<int>(90 * std::atof(words[3])); // 90 a second, the rate of a headset
        auto due = std::chrono::steady_clock::now();
        for (int picture = 1; picture <= pictures; picture++) {
            // From 60 mm down at 5 mm a second, until the fingertip of 7 mm is 1 mm inside the foot.
            const double tip[3] = {0.050, 0.020, std::max(0.060 - 0.005 * picture / 90, 0.010)};
            poses.send(std::vector<proximity_finger_pose>{proximity::pose_of(0, tip)});
            std::this_thread::sleep_until(due += std::chrono::nanoseconds(1000000000 / 90)); // draw here
            const proximity::reading now = frames.read(); // never waits
            if (picture % 9 == 0)
                show(now);
        }
        std::printf("%s\n", frames.counted().text().c_str());
    } catch (const proximity::error &failure) {
        std::fprintf(stderr, "example: %s\n", failure.what());
        return 1;
    }
}
