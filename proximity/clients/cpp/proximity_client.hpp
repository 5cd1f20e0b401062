// proximity_client.hpp: frames from a proximity service, and poses and moves to it, over UDP, in C++20.
//
// Made by `proximity client cpp`; changes here are lost. It needs proximity_message.h, which is made with
// it, and the standard library; on Windows link ws2_32. IPv4 only. One thread uses a receiver, one a sender.
//
//   proximity::receiver frames({.port = 9100});            // udp://127.0.0.1:9100 in the scene file's `publish`
//   proximity::sender poses({.port = 9101});               // udp://127.0.0.1:9101 as its `input.poses`
//   proximity::reading now = frames.read();                // never waits; the present state
//
// Opening an end may throw a proximity::error with a sentence. Otherwise only sending throws, on a network that
// does not work.
#ifndef PROXIMITY_CLIENT_HPP
#define PROXIMITY_CLIENT_HPP

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#ifdef _WIN32
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <winsock2.h>
#include <ws2tcpip.h>
#else
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#endif

#include "proximity_message.h"

namespace proximity {

/// Reason why an end cannot be opened, or a message not be sent: a sentence.
class error : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// Reason why a message was not used.
enum class flaw : std::size_t { none, short_, magic, version, size, checksum, old, future, content, count };

inline constexpr std::array<const char *, static_cast<std::size_t>(flaw::count)> flaw_names = {
    "used", "short", "magic", "version", "size", "checksum", "old", "future", "content"};

/// Numbers of messages seen by a receiver.
struct counts {
    std::uint64_t received = 0;   // used
    std::uint64_t lost = 0;       // numbers missing since the first
    std::uint64_t sessions = 0;   // runs of the publisher
    std::uint64_t refused = 0;    // from another sender
    std::uint64_t unverified = 0; // not verified by the key
    std::array<std::uint64_t, static_cast<std::size_t>(flaw::count)> flawed{}; // by reason

    std::uint64_t of(flaw reason) const { return flawed[static_cast<std::size_t>(reason)]; }

    /// All of them in a line.
    std::string text() const
    {
        std::string line = "received " + std::to_string(received) + ", lost " + std::to_string(lost)
                           + "; not used: unverified " + std::to_string(unverified) + ", refused "
                           + std::to_string(refused);
        for (std::size_t reason = 1; reason < flawed.size(); reason++)
            if (flawed[reason] > 0)
                line += std::string(", ") + flaw_names[reason] + " " + std::to_string(flawed[reason]);
        return line;
    }
};

/// Parameters of the ageing of frames.
struct limits {
    std::int64_t stale_after_ns = PROXIMITY_STALE_AFTER_NS; // after a frame's end of validity
    double max_speed = 3.0;                              // m/s, of a finger
    double max_acceleration = 120.0;                     // m/s2
};

/// State at a reading. Header and contacts are overwritten by the next reading.
struct reading {
    proximity_state state = PROXIMITY_STATE_STALE; // that of the frame, or worse
    bool is_new = false;                     // no reading before had this frame
    std::int64_t now_ns = 0;                 // on the publisher's clock
    std::int64_t age_ns = -1;                // since the oldest pose; -1: no frame yet
    const proximity_frame_header *header = nullptr; // as published; null: no frame yet
    std::span<const proximity_contact> contacts;    // aged: LATE has widening bounds, STALE no values

    /// Test whether distances may be used unchanged.
    bool is_valid() const { return state == PROXIMITY_STATE_OK || state == PROXIMITY_STATE_DEGRADED; }
};

/// The monotonic clock, ns; on Linux that of a service on this machine.
inline std::int64_t clock_ns()
{
    return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

#ifdef __linux__
inline constexpr bool clock_is_that_of_services = true;
#else
inline constexpr bool clock_is_that_of_services = false; // elsewhere it is estimated from arrivals
#endif

/// Validates frames and ages the newest; without a network, so that other transports can use it.
class frame_reader {
public:
    /// `shares_clock`: the publisher is on this machine; `is_keyed`: messages were verified by a key.
    frame_reader(bool shares_clock, bool is_keyed, limits ageing)
        : ageing_(ageing)
    {
        receiver_.shares_clock = shares_clock ? 1 : 0;
        receiver_.is_keyed = is_keyed ? 1 : 0;
    }

    /// Read a frame, or a description, that arrived at an instant of this machine's clock; return its defect.
    flaw offer(std::span<const std::byte> message, std::int64_t now_ns)
    {
        const flaw reason = is_description(message) ? describe(message) : judge(message, now_ns);
        if (reason != flaw::none)
            counts_.flawed[static_cast<std::size_t>(reason)]++;
        return reason;
    }

    /// State at an instant of this machine's clock.
    reading at(std::int64_t now_ns)
    {
        reading now;
        now.now_ns = now_ns_ = proximity_theirs(&receiver_, now_ns);
        if (receiver_.received == 0)
            return now;
        now.state = proximity_trust(&receiver_, &held_, now.now_ns, ageing_.stale_after_ns);
        now.is_new = std::exchange(is_new_, false);
        now.age_ns = std::max<std::int64_t>(proximity_time_between(held_.pose_ns, now.now_ns), 0);
        now.header = &held_;
        now.contacts = contacts_;
        if (now.is_valid())
            return now;
        shown_.assign(contacts_.begin(), contacts_.end());
        const bool is_used = now.state == PROXIMITY_STATE_LATE && held_.state != PROXIMITY_STATE_STARTING;
        for (proximity_contact &contact : shown_) {
            if (is_used)
                proximity_widen(&contact, now.now_ns, ageing_.max_speed, ageing_.max_acceleration);
            else
                proximity_forget(&contact);
        }
        now.contacts = shown_;
        return now;
    }

    /// The newest valid contact of a finger, as published, whose pose is at most that old at the last reading; null if
    /// there is none. For a display, while frames are late.
    const proximity_contact *last_valid(std::uint32_t finger,
                                        std::chrono::nanoseconds at_most = std::chrono::milliseconds(100)) const
    {
        const bool is_known = finger < valid_.size() && (receiver_.shares_clock || receiver_.clock.is_certain);
        const proximity_contact *contact = is_known ? &valid_[finger] : nullptr;
        const bool is_used = is_known && (contact->flags & PROXIMITY_FLAG_TRACKED) != 0
                             && proximity_time_between(contact->pose_ns, now_ns_) <= at_most.count();
        return is_used ? contact : nullptr;
    }

    /// The name of a part of the newest frame, which numbers it as contact.part; empty until it is known, within
    /// a second of the first frame and of each change.
    std::string_view part_name(std::int32_t part) const
    {
        const bool is_of_frame = receiver_.received > 0 && names_of_[0] == held_.session && names_of_[1] == held_.epoch;
        const auto row = static_cast<std::size_t>(part); // -1, no part, is beyond all
        return is_of_frame && row < part_names_.size() ? std::string_view(part_names_[row]) : std::string_view();
    }

    /// Number of changes, additions, deformations and moves that the service has refused, and the last of them: its kind
    /// and the reason. Known within a second.
    std::uint64_t refused() const { return refused_; }
    std::string_view refusal() const { return refusal_; }

    const counts &counted() const { return counts_; }
    counts &counted() { return counts_; }

private:
    using numbers = std::array<std::uint64_t, 4>;        // of a description: session, epoch, parts, fingers

    bool is_new_ = false;
    limits ageing_;
    counts counts_;
    proximity_receiver receiver_{};
    proximity_frame_header held_{};
    std::int64_t now_ns_ = 0;                            // of the last reading, their clock
    std::vector<proximity_contact> contacts_, shown_;
    std::vector<proximity_contact> valid_;               // the newest of each finger, while parts keep their numbers
    numbers names_of_{}, labels_of_{};
    std::vector<std::string> part_names_;
    std::uint64_t refused_ = 0;
    std::string refusal_;
    std::map<std::uint64_t, std::string> labels_; // of an incomplete description

    static bool is_description(std::span<const std::byte> message)
    {
        std::uint32_t magic = 0;
        if (message.size() >= sizeof(proximity_prefix))
            std::memcpy(&magic, message.data(), sizeof magic);
        return magic == PROXIMITY_DESCRIPTION_MAGIC;
    }

    /// Read one message of a description, whose names are used once it is complete.
    flaw describe(std::span<const std::byte> message)
    {
        proximity_description_header header;
        const int wrong = proximity_check(message.data(), message.size(), PROXIMITY_DESCRIPTION_MAGIC, sizeof header,
                                          sizeof(proximity_label), offsetof(proximity_description_header, count));
        if (wrong != PROXIMITY_FLAW_NONE)
            return static_cast<flaw>(wrong);
        std::memcpy(&header, message.data(), sizeof header);
        const numbers of{header.session, header.epoch, header.part_count, header.finger_count};
        const std::uint64_t total = of[2] + of[3], first = header.first;
        if (total > PROXIMITY_MAX_NAMES || first + header.count > total)
            return flaw::content;
        refused_ = header.refused;
        refusal_.assign(header.refusal, std::find(header.refusal, std::end(header.refusal), '\0'));
        if (of != labels_of_ || first == 0)
            labels_.clear();
        labels_of_ = of;
        for (std::size_t i = 0; i < header.count; i++) {
            proximity_label label;
            std::memcpy(&label, message.data() + sizeof header + i * sizeof label, sizeof label);
            labels_[first + i].assign(label.name, std::find(label.name, std::end(label.name), '\0'));
        }
        if (labels_.size() == total) {
            names_of_ = of;
            part_names_.clear();
            for (const auto &[row, name] : labels_)
                if (row < of[2])
                    part_names_.push_back(name);
        }
        return flaw::none;
    }

    flaw judge(std::span<const std::byte> message, std::int64_t now_ns)
    {
        const flaw reason = static_cast<flaw>(
            proximity_take_frame(&receiver_, message.data(), message.size(), PROXIMITY_MAX_RECORDS, now_ns));
        if (reason != flaw::none)
            return reason;
        const std::uint64_t session = held_.session, epoch = held_.epoch;
        std::memcpy(&held_, message.data(), sizeof held_);
        contacts_.resize(held_.count);
        if (held_.count > 0)
            std::memcpy(contacts_.data(), message.data() + sizeof held_, held_.count * sizeof(proximity_contact));
        if (session != held_.session || epoch != held_.epoch)
            valid_.clear();
        valid_.resize(held_.count);
        for (std::size_t i = 0; i < valid_.size(); i++)
            if ((contacts_[i].flags & PROXIMITY_FLAG_TRACKED) != 0
                && (held_.state == PROXIMITY_STATE_OK || held_.state == PROXIMITY_STATE_DEGRADED))
                valid_[i] = contacts_[i];
        counts_.received = receiver_.received;
        counts_.lost = receiver_.lost;
        counts_.sessions = receiver_.sessions;
        is_new_ = true;
        return reason;
    }
};

using key_bytes = std::array<std::uint8_t, PROXIMITY_KEY_BYTES>;

/// Read a key written by `proximity client key`.
inline key_bytes read_key(const std::string &path)
{
    const auto refuse = [&](const std::string &what) { return error("the key " + path + " " + what); };
#ifndef _WIN32
    struct stat status{};
    if (stat(path.c_str(), &status) != 0)
        throw refuse("cannot be read (`proximity client key --out FILE` makes one)");
    if (!S_ISREG(status.st_mode))
        throw refuse("is not a regular file");
    if ((status.st_mode & 077) != 0)
        throw refuse("may be used by others (expected permissions 0600)");
#endif
    std::ifstream stream(path, std::ios::binary);
    if (!stream)
        throw refuse("cannot be read (`proximity client key --out FILE` makes one)");
    std::string text(2 * PROXIMITY_KEY_BYTES + 1, '\0');
    stream.read(text.data(), static_cast<std::streamsize>(text.size()));
    key_bytes key{};
    if (!proximity_key_of_text(text.c_str(), key.data()))
        throw refuse("is not a key (expected 64 hexadecimal digits)");
    return key;
}

namespace detail {

#ifdef _WIN32
using handle = SOCKET;
inline const handle no_socket = INVALID_SOCKET;
inline int last_error() { return WSAGetLastError(); }
inline void close_socket(handle socket) { closesocket(socket); }
inline bool is_nobody(int code) { return code == WSAECONNREFUSED || code == WSAECONNRESET || code == WSAEHOSTUNREACH; }
inline bool is_full(int code) { return code == WSAEWOULDBLOCK || code == WSAENOBUFS; }
inline bool never_waits(handle socket)
{
    u_long is_on = 1;
    return ioctlsocket(socket, FIONBIO, &is_on) == 0;
}
inline void start_network()
{
    static const int failed = [] {
        WSADATA about;
        return WSAStartup(MAKEWORD(2, 2), &about);
    }();
    if (failed != 0)
        throw error("Winsock does not start: " + std::system_category().message(failed));
}
#else
using handle = int;
inline const handle no_socket = -1;
inline int last_error() { return errno; }
inline void close_socket(handle socket) { ::close(socket); }
inline bool is_nobody(int code)
{
    return code == ECONNREFUSED || code == ECONNRESET || code == EHOSTUNREACH || code == EHOSTDOWN;
}
inline bool is_full(int code) { return code == EAGAIN || code == EWOULDBLOCK || code == ENOBUFS || code == ENOMEM; }
inline bool never_waits(handle socket) { return fcntl(socket, F_SETFL, O_NONBLOCK) == 0; }
inline void start_network() {}
#endif

inline std::string because() { return " (" + std::system_category().message(last_error()) + ")"; }

inline sockaddr_in endpoint(const std::string &host, std::uint16_t port)
{
    sockaddr_in found{};
    found.sin_family = AF_INET;
    found.sin_port = htons(port);
    if (inet_pton(AF_INET, host.c_str(), &found.sin_addr) != 1)
        throw error("\"" + host + "\" is not an IPv4 address, expected one such as 127.0.0.1");
    return found;
}

inline bool is_loopback(const sockaddr_in &end) { return ntohl(end.sin_addr.s_addr) >> 24 == 127; }
inline const sockaddr *as_address(const sockaddr_in &end)
{
    return static_cast<const sockaddr *>(static_cast<const void *>(&end));
}

/// A socket that never waits, bound exclusively to an end.
class udp_socket {
public:
    explicit udp_socket(const sockaddr_in &here, const std::string &shown)
    {
        start_network();
        handle_ = ::socket(AF_INET, SOCK_DGRAM, 0);
        if (handle_ == no_socket)
            throw error("no socket could be made" + because());
#ifdef _WIN32
        const char is_on = 1;
        setsockopt(handle_, SOL_SOCKET, SO_EXCLUSIVEADDRUSE, &is_on, sizeof is_on);
#endif
        if (!never_waits(handle_) || bind(handle_, as_address(here), sizeof here) != 0) {
            const std::string why = because();
            close_socket(handle_);
            throw error("cannot use " + shown + why);
        }
    }
    ~udp_socket() { close_socket(handle_); }
    udp_socket(const udp_socket &) = delete;
    udp_socket &operator=(const udp_socket &) = delete;
    handle get() const { return handle_; }

private:
    handle handle_;
};

inline std::string shown(const std::string &host, std::uint16_t port) { return host + ", port " + std::to_string(port); }

} // namespace detail

/// Address of incoming frames: udp://host:port?from=from&key=key.
struct receiver_options {
    std::string host = "127.0.0.1"; // of this machine, to listen on
    std::uint16_t port = 0;
    std::string from = {}; // accepted sender; needed unless `host` is on loopback
    std::string key = {};  // a file written by `proximity client key`; empty: none
    limits ageing = {};
};

/// Receives and validates frames: only the newest counts, with its present validity.
class receiver {
public:
    explicit receiver(const receiver_options &options)
        : receiver(options, detail::endpoint(options.host, options.port),
                   detail::endpoint(options.from.empty() ? options.host : options.from, 0))
    {
    }

    /// Read arrived messages and return the present state; never waits.
    reading read()
    {
        for (int taken = 0, unused = 0; taken < PROXIMITY_MAX_AT_ONCE && unused < PROXIMITY_MAX_FLAWED; taken++) {
            sockaddr_in sender{};
            socklen_t length = sizeof sender;
            const auto size = recvfrom(socket_.get(), reinterpret_cast<char *>(buffer_.data()), buffer_.size(), 0,
                                       reinterpret_cast<sockaddr *>(&sender), &length);
            if (size < 0 && detail::is_nobody(detail::last_error()))
                continue; // Windows reports here that an earlier datagram had no receiver
            if (size < 0)
                break;
            unused += take(static_cast<std::size_t>(size), sender) ? 0 : 1;
        }
        return frames_.at(clock_ns());
    }

    /// Like read(), but wait for a new frame, with a time limit.
    reading wait(std::chrono::nanoseconds timeout)
    {
        const auto ends = std::chrono::steady_clock::now() + timeout;
        for (;;) {
            const reading now = read();
            const auto left = std::chrono::ceil<std::chrono::milliseconds>(ends - std::chrono::steady_clock::now());
            if (now.is_new || left.count() <= 0)
                return now;
            const int most = static_cast<int>(std::min<std::int64_t>(left.count(), 1000));
#ifdef _WIN32
            WSAPOLLFD waiting{socket_.get(), POLLIN, 0};
            WSAPoll(&waiting, 1, most);
#else
            pollfd waiting{socket_.get(), POLLIN, 0};
            poll(&waiting, 1, most);
#endif
        }
    }

    /// The name of a part of the newest frame; empty until it is known.
    std::string_view part_name(std::int32_t part) const { return frames_.part_name(part); }

    /// Last valid contacts and refusals, as frame_reader describes them.
    const proximity_contact *last_valid(std::uint32_t finger,
                                        std::chrono::nanoseconds at_most = std::chrono::milliseconds(100)) const
    {
        return frames_.last_valid(finger, at_most);
    }
    std::uint64_t refused() const { return frames_.refused(); }
    std::string_view refusal() const { return frames_.refusal(); }

    const counts &counted() const { return frames_.counted(); }

private:
    receiver(const receiver_options &options, const sockaddr_in &here, const sockaddr_in &from)
        : from_(from), frames_((check(options, here), clock_is_that_of_services) && detail::is_loopback(from),
                               !options.key.empty(), options.ageing),
          socket_(here, detail::shown(options.host, options.port)), buffer_(1 << 16)
    {
        if (!options.key.empty())
            key_ = read_key(options.key);
    }

    static void check(const receiver_options &options, const sockaddr_in &here)
    {
        if (options.port == 0)
            throw error("port is 0, expected one from 1 to 65535");
        if (options.from.empty() && !detail::is_loopback(here))
            throw error(options.host + " can be reached by others, expected `from`, the one to listen to");
    }

    bool take(std::size_t size, const sockaddr_in &sender)
    {
        // On loopback an unbound sender has the address 127.0.0.1.
        const bool is_expected = sender.sin_addr.s_addr == from_.sin_addr.s_addr
                                 || (detail::is_loopback(from_) && ntohl(sender.sin_addr.s_addr) == INADDR_LOOPBACK);
        if (!is_expected) {
            frames_.counted().refused++;
            return false;
        }
        if (key_ && (size = proximity_verified(key_->data(), buffer_.data(), size)) == 0) {
            frames_.counted().unverified++;
            return false;
        }
        return frames_.offer(std::span(buffer_).first(size), clock_ns()) == flaw::none;
    }

    sockaddr_in from_;
    frame_reader frames_;
    detail::udp_socket socket_;
    std::vector<std::byte> buffer_;
    std::optional<key_bytes> key_;
};

/// Destination of poses and moves: udp://host:port?bind=bind&key=key.
struct sender_options {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;
    std::string bind = {}; // address of this machine to send from; needed unless `host` is on loopback
    std::string key = {};
};

/// A pose of a finger whose centre is there; velocity and bend are not known. Give all fingers that were seen
/// together the same instant: clock_ns() once.
inline proximity_finger_pose pose_of(std::uint32_t finger, std::span<const double, 3> position,
                                     std::int64_t pose_ns = clock_ns())
{
    proximity_finger_pose pose{};
    pose.finger = finger;
    pose.pose_ns = pose_ns;
    std::copy(position.begin(), position.end(), pose.position);
    return pose;
}

namespace detail {
template <std::size_t Size> void put_text(char (&there)[Size], std::string_view text, const char *what)
{
    if (text.empty() || text.size() > Size)
        throw error(std::string(what) + " has " + std::to_string(text.size()) + " bytes, expected 1 to "
                    + std::to_string(Size));
    std::memcpy(there, text.data(), text.size());
}

template <std::size_t Size> void name_part(char (&there)[Size], std::string_view name)
{
    put_text(there, name, "a part's name");
}
} // namespace detail

/// A change of a part: PROXIMITY_PART_ACTION_HIDE, _SHOW or _REMOVE.
inline proximity_change change_of(std::string_view name, std::uint32_t action)
{
    proximity_change change{};
    detail::name_part(change.name, name);
    change.action = action;
    return change;
}

/// An addition: a file of a folder of `parts_from`, such as "lid.stl", under that name and with its origin there.
/// Set `rotation` if it is turned, and `units` if the file declares none and is not in mm.
inline proximity_addition addition_of(std::string_view name, std::string_view file,
                                      std::span<const double, 3> translation)
{
    proximity_addition addition{};
    detail::name_part(addition.name, name);
    detail::put_text(addition.file, file, "a file's name");
    std::copy(translation.begin(), translation.end(), addition.translation);
    return addition;
}

/// A move: the part is at rest, with its axes those of the scene and its origin there. Set `rotation` if the part is
/// turned, and `velocity` while it moves.
inline proximity_part_move move_of(std::string_view name, std::span<const double, 3> translation,
                                   std::int64_t pose_ns = clock_ns())
{
    proximity_part_move move{};
    detail::name_part(move.name, name);
    move.pose_ns = pose_ns;
    std::fill_n(move.velocity, 3, 0.0);
    std::fill_n(move.angular_velocity, 3, 0.0);
    std::copy(translation.begin(), translation.end(), move.translation);
    return move;
}

/// Sends poses of fingers, moves and changes of parts.
class sender {
public:
    explicit sender(const sender_options &options)
        : sender(options, detail::endpoint(options.host, options.port))
    {
    }

    void send(std::span<const proximity_finger_pose> poses) { send_records(PROXIMITY_POSES_MAGIC, poses); }
    void send(std::span<const proximity_path_pose> poses) { send_records(PROXIMITY_PATH_POSES_MAGIC, poses); }
    void send(std::span<const proximity_glove_pose> poses) { send_records(PROXIMITY_GLOVE_POSES_MAGIC, poses); }
    void send(std::span<const proximity_part_move> moves) { send_records(PROXIMITY_MOVES_MAGIC, moves); }
    void send(std::span<const proximity_change> changes) { send_records(PROXIMITY_CHANGES_MAGIC, changes); }
    void send(std::span<const proximity_addition> additions) { send_records(PROXIMITY_ADDITIONS_MAGIC, additions); }
    /// All vertices of one part, 64 a record, in order.
    void send(std::span<const proximity_deformation> part) { send_records(PROXIMITY_DEFORMATIONS_MAGIC, part); }

    /// Messages for which the system had no buffer space.
    std::uint64_t lost() const { return lost_; }

private:
    sender(const sender_options &options, const sockaddr_in &there)
        : socket_(here(options, there), "the address to send from"), shown_(detail::shown(options.host, options.port))
    {
        if (connect(socket_.get(), detail::as_address(there), sizeof there) != 0)
            throw error("cannot send to " + shown_ + detail::because());
        if (!options.key.empty())
            key_ = read_key(options.key);
        begin_session();
    }

    static sockaddr_in here(const sender_options &options, const sockaddr_in &there)
    {
        if (options.port == 0)
            throw error("port is 0, expected one from 1 to 65535");
        if (!options.bind.empty())
            return detail::endpoint(options.bind, 0);
        if (!detail::is_loopback(there))
            throw error(options.host + " is not on this machine, expected `bind`, the address to send from");
        return detail::endpoint("127.0.0.1", 0);
    }

    template <class Record> void send_records(std::uint32_t magic, std::span<const Record> records)
    {
        const std::size_t size = sizeof(proximity_input_header) + records.size_bytes();
        const std::size_t most = 65507 - (key_ ? PROXIMITY_TAG_BYTES : 0);
        if (size > most || records.size() > PROXIMITY_MAX_RECORDS)
            throw error("a message of " + std::to_string(size) + " bytes does not fit into a datagram (expected at most "
                        + std::to_string(most) + " bytes)");
        if (calendar_offset_ns() - std::exchange(awake_ns_, calendar_offset_ns()) > 1000000000)
            begin_session(); // the machine was suspended, and its monotonic clock stopped
        buffer_.resize(size + PROXIMITY_TAG_BYTES);
        proximity_input_header header{};
        header.send_ns = clock_ns();
        header.count = static_cast<std::uint32_t>(records.size());
        std::memcpy(buffer_.data(), &header, sizeof header);
        if (!records.empty())
            std::memcpy(buffer_.data() + sizeof header, records.data(), records.size_bytes());
        proximity_seal(buffer_.data(), size, magic, sizeof header, session_, sequences_[magic]++);
        if (key_)
            proximity_tag(key_->data(), buffer_.data(), size, buffer_.data() + size);
        send_datagram(size + (key_ ? PROXIMITY_TAG_BYTES : 0));
    }

    void send_datagram(std::size_t size)
    {
        const auto is_sent = [&] {
            return ::send(socket_.get(), reinterpret_cast<const char *>(buffer_.data()), size, 0) >= 0;
        };
        // The system may report here that an earlier datagram had no receiver; this one was not sent.
        if (is_sent() || (detail::is_nobody(detail::last_error()) && is_sent()))
            return;
        if (detail::is_full(detail::last_error()))
            lost_++;
        else if (!detail::is_nobody(detail::last_error()))
            throw error("cannot send to " + shown_ + detail::because());
    }

    static std::int64_t calendar_ns()
    {
        return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
    }
    static std::int64_t calendar_offset_ns() { return calendar_ns() - clock_ns(); }

    void begin_session()
    {
        session_ = std::max(static_cast<std::uint64_t>(calendar_ns()), session_ + 1);
        sequences_.clear();
    }

    detail::udp_socket socket_;
    std::string shown_;
    std::optional<key_bytes> key_;
    std::uint64_t session_ = 0, lost_ = 0;
    std::int64_t awake_ns_ = calendar_offset_ns();
    std::map<std::uint32_t, std::uint64_t> sequences_; // next number, by the kind's magic
    std::vector<std::uint8_t> buffer_;
};

} // namespace proximity

#endif
