// Command-line driver of proximity_client.hpp, see client_programs.py.
#include <cstdio>
#include <iostream>
#include <iterator>
#include <thread>

#include "proximity_client.hpp"

static std::vector<char> bytes_of(const char *path)
{
    std::ifstream stream(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

template <class T> static T taken(const char *&at)
{
    T value;
    std::memcpy(&value, at, sizeof value);
    at += sizeof value;
    return value;
}

template <class T> static void put(std::ostream &out, T value)
{
    out.write(reinterpret_cast<const char *>(&value), sizeof value);
}

static void read_events(const char *from, const char *to)
{
    const std::vector<char> events = bytes_of(from);
    const char *at = events.data(), *end = at + events.size();
    std::ofstream out(to, std::ios::binary);
    const bool is_shared = taken<std::uint8_t>(at) != 0, is_keyed = taken<std::uint8_t>(at) != 0;
    proximity::frame_reader reader(is_shared, is_keyed, {});
    while (at < end) {
        const auto kind = taken<std::uint8_t>(at);
        const auto now = taken<std::int64_t>(at);
        if (kind == 1) {
            const auto size = taken<std::uint32_t>(at);
            put(out, static_cast<std::uint8_t>(reader.offer(std::as_bytes(std::span(at, size)), now)));
            at += size;
            continue;
        }
        const proximity::reading known = reader.at(now);
        put(out, static_cast<std::uint8_t>(known.state));
        put(out, static_cast<std::uint8_t>(known.is_new));
        put(out, known.now_ns);
        put(out, known.age_ns);
        put(out, static_cast<std::uint32_t>(known.contacts.size()));
        for (const proximity_contact &contact : known.contacts)
            put(out, contact);
        for (std::uint32_t finger = 0; finger < known.contacts.size(); finger++) {
            const proximity_contact *valid = reader.last_valid(finger);
            put(out, static_cast<std::uint8_t>(valid != nullptr));
            put(out, valid != nullptr ? *valid : proximity_contact{});
        }
    }
    put(out, reader.counted().received);
    put(out, reader.counted().lost);
    put(out, reader.counted().sessions);
    for (std::int32_t part = -1; part < 4; part++)
        out << reader.part_name(part) << "\n";
    out << reader.refused() << " " << reader.refusal() << "\n";
}

static void print_tags(const char *key_path, const char *data_path, int count, char **sizes)
{
    const proximity::key_bytes key = proximity::read_key(key_path);
    const std::vector<char> data = bytes_of(data_path);
    for (int i = 0; i < count; i++) {
        std::uint8_t tag[PROXIMITY_TAG_BYTES];
        proximity_tag(key.data(), data.data(), static_cast<std::size_t>(std::atoi(sizes[i])), tag);
        for (std::uint8_t byte : tag)
            std::printf("%02x", static_cast<unsigned>(byte));
        std::printf("\n");
    }
}

int main(int count, char **words)
{
    const std::string mode = words[1];
    const auto word = [&](int i) { return std::string(words[i]) == "-" ? std::string() : std::string(words[i]); };
    try {
        if (mode == "read") {
            read_events(words[2], words[3]);
        } else if (mode == "tag") {
            print_tags(words[2], words[3], count - 4, words + 4);
        } else if (mode == "send" || mode == "sender") {
            proximity::sender sender({.host = word(2), .port = static_cast<std::uint16_t>(std::atoi(words[3])),
                                   .bind = word(4), .key = word(5)});
            const double first[3] = {1, 2, 3}, second[3] = {4, 5, 6}, third[3] = {7, 8, 9};
            const std::vector<proximity_finger_pose> poses = {proximity::pose_of(0, first), proximity::pose_of(1, second)};
            const std::vector<proximity_part_move> moves = {proximity::move_of("lid \xc3\xa4", third)};
            if (count > 6)
                proximity::move_of(std::string(65, 'x'), third);
            if (mode == "sender")
                sender.send(std::vector<proximity_finger_pose>(4096));
            sender.send(poses);
            sender.send(moves);
            sender.send(std::vector{proximity::change_of("lid \xc3\xa4", PROXIMITY_PART_ACTION_HIDE)});
            sender.send(std::vector{proximity::addition_of("lid \xc3\xa4", "inner/lid.stl", third)});
            sender.send(poses);
        } else if (mode == "listen") {
            proximity::receiver receiver({.host = word(2), .port = static_cast<std::uint16_t>(std::atoi(words[3])),
                                       .from = word(4), .key = word(5)});
            std::setvbuf(stdout, nullptr, _IOLBF, 256);
            std::printf("listening\n");
            for (proximity::reading now = receiver.read(); now.state != PROXIMITY_STATE_STOPPING;
                 now = receiver.wait(std::chrono::milliseconds(100)))
                if (now.is_new && now.is_valid())
                    std::printf("%u %.6f\n", static_cast<unsigned>(now.contacts[0].finger), now.contacts[0].signed_distance);
            const proximity::counts &seen = receiver.counted();
            std::printf("received %llu unverified %llu\n", static_cast<unsigned long long>(seen.received),
                        static_cast<unsigned long long>(seen.unverified));
        }
    } catch (const proximity::error &failure) {
        std::printf("%s\n", failure.what());
        return 1;
    }
}
