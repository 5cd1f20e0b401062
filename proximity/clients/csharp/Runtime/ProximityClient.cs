// ProximityClient.cs: frames from a proximity service, and poses and moves to it, over UDP, for Unity and .NET.
//
// Made by `proximity client csharp`; changes here are lost. Buffers are allocated when an end is opened, and when the
// number of fingers changes; a frame makes no garbage. IPv4 only. One thread uses one object. Opening an end may throw
// a ProximityServiceError with a sentence.
using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Net;
using System.Net.Sockets;
using System.Runtime.InteropServices;
using System.Text;

namespace Proximity
{
    public class ProximityServiceError : Exception
    {
        public ProximityServiceError(string sentence) : base(sentence) { }
    }

    /// <summary>Reason why a message was not used.</summary>
    public enum ProximityFlaw { None, Short, Magic, Version, Size, Checksum, Old, Future, Content }

    /// <summary>Numbers of messages seen by a subscriber.</summary>
    public sealed class ProximityCounts
    {
        public long Received, Sessions, Unverified;
        public ulong Lost; // numbers missing since the first
        public readonly long[] Flawed = new long[9]; // by ProximityFlaw

        /// <summary>All of them in a line.</summary>
        public override string ToString()
        {
            var line = new StringBuilder("received " + Received + ", lost " + Lost + "; not used: unverified " + Unverified);
            for (int reason = 1; reason < Flawed.Length; reason++)
                if (Flawed[reason] > 0)
                    line.Append(", " + ((ProximityFlaw)reason).ToString().ToLowerInvariant() + " " + Flawed[reason]);
            return line.ToString();
        }
    }

    /// <summary>The monotonic clock; on Linux that of a service on this machine.</summary>
    public static class ProximityClock
    {
        public static readonly bool IsThatOfServices = Environment.OSVersion.Platform == PlatformID.Unix
            && Directory.Exists("/proc/self"); // Linux, Android; elsewhere it is estimated from arrivals
        private static readonly long PerTick = 1000000000L / Stopwatch.Frequency;

        public static long Ns
        {
            get
            {
                long ticks = Stopwatch.GetTimestamp();
                if (PerTick * Stopwatch.Frequency == 1000000000L)
                    return ticks * PerTick;
                return ticks / Stopwatch.Frequency * 1000000000L
                    + ticks % Stopwatch.Frequency * 1000000000L / Stopwatch.Frequency;
            }
        }

        public static long CalendarNs
        {
            get { return (DateTime.UtcNow.Ticks - 621355968000000000L) * 100L; }
        }
    }

    /// <summary>Checksum and tag of messages.</summary>
    public sealed unsafe class ProximityKey
    {
        public const int TagBytes = 16;
        private static readonly uint[] CrcTable = MakeCrcTable();
        private static readonly uint[] Start =
        {
            0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
        };
        private static readonly string[] Order =
        {
            "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d",
            "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0",
        };
        private static readonly int[] Places = MakePlaces();
        private readonly byte[] key = new byte[32];
        private readonly byte[] block = new byte[64];
        private readonly uint[] h = new uint[8], m = new uint[16], v = new uint[16];

        /// <summary>Read a key written by `proximity client key`. The permissions of its file are not checked
        /// here.</summary>
        public ProximityKey(string path)
        {
            string digits;
            try
            {
                digits = File.ReadAllText(path).TrimEnd('\r', '\n');
            }
            catch (Exception failure)
            {
                throw new ProximityServiceError("the key " + path + " cannot be read (" + failure.Message + ")");
            }
            bool isKey = digits.Length == 64;
            for (int i = 0; isKey && i < 64; i++)
            {
                int digit = Digit(digits[i]);
                isKey = digit >= 0;
                key[i / 2] = (byte)(key[i / 2] << 4 | (digit & 15));
            }
            if (!isKey)
                throw new ProximityServiceError("the key " + path + " is not a key (expected 64 hexadecimal digits)");
        }

        /// <summary>CRC-32 of zlib.</summary>
        public static uint Crc32(byte[] bytes, int first, int end)
        {
            uint crc = 0xffffffff;
            for (int i = first; i < end; i++)
                crc = crc >> 8 ^ CrcTable[(crc ^ bytes[i]) & 0xff];
            return ~crc;
        }

        /// <summary>Write the tag of the first *size* bytes at *at*: keyed BLAKE2s (RFC 7693).</summary>
        public void Tag(byte[] message, int size, byte[] tag, int at)
        {
            Start.CopyTo(h, 0);
            h[0] ^= 0x01010000u | 32u << 8 | TagBytes;
            Array.Clear(block, 0, 64);
            key.CopyTo(block, 0);
            Hash(64, size == 0);
            for (int first = 0; first < size; first += 64)
            {
                int count = Math.Min(64, size - first);
                Array.Clear(block, 0, 64);
                Array.Copy(message, first, block, 0, count);
                Hash(64 + first + count, first + count == size);
            }
            for (int i = 0; i < TagBytes; i++)
                tag[at + i] = (byte)(h[i / 4] >> 8 * (i % 4));
        }

        /// <summary>Size of the message in a datagram; 0: the key does not verify it.</summary>
        public int Verified(byte[] datagram, int size, byte[] scratch)
        {
            int end = size - TagBytes, difference = 0;
            if (end <= 0)
                return 0;
            Tag(datagram, end, scratch, 0);
            for (int i = 0; i < TagBytes; i++) // in time independent of the tag's contents
                difference |= scratch[i] ^ datagram[end + i];
            return difference == 0 ? end : 0;
        }

        private void Hash(int taken, bool isLast)
        {
            for (int i = 0; i < 16; i++)
                m[i] = (uint)(block[4 * i] | block[4 * i + 1] << 8 | block[4 * i + 2] << 16 | block[4 * i + 3] << 24);
            h.CopyTo(v, 0);
            Start.CopyTo(v, 8);
            v[12] ^= (uint)taken;
            if (isLast)
                v[14] = ~v[14];
            for (int round = 0; round < 160; round += 16)
            {
                for (int i = 0; i < 4; i++)
                    Mix(i, i + 4, i + 8, i + 12, m[Places[round + 2 * i]], m[Places[round + 2 * i + 1]]);
                for (int i = 0; i < 4; i++)
                    Mix(i, 4 + (i + 1) % 4, 8 + (i + 2) % 4, 12 + (i + 3) % 4, m[Places[round + 8 + 2 * i]],
                        m[Places[round + 9 + 2 * i]]);
            }
            for (int i = 0; i < 8; i++)
                h[i] ^= v[i] ^ v[i + 8];
        }

        private void Mix(int a, int b, int c, int d, uint x, uint y)
        {
            v[a] += v[b] + x;
            v[d] = Turned(v[d] ^ v[a], 16);
            v[c] += v[d];
            v[b] = Turned(v[b] ^ v[c], 12);
            v[a] += v[b] + y;
            v[d] = Turned(v[d] ^ v[a], 8);
            v[c] += v[d];
            v[b] = Turned(v[b] ^ v[c], 7);
        }

        private static uint Turned(uint x, int bits) { return x >> bits | x << 32 - bits; }

        private static int Digit(char c)
        {
            return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10
                : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
        }

        private static int[] MakePlaces()
        {
            var places = new int[160];
            for (int i = 0; i < 160; i++)
                places[i] = Digit(Order[i / 16][i % 16]);
            return places;
        }

        private static uint[] MakeCrcTable()
        {
            var table = new uint[256];
            for (uint i = 0; i < 256; i++)
            {
                uint crc = i;
                for (int bit = 0; bit < 8; bit++)
                    crc = (crc & 1) != 0 ? crc >> 1 ^ 0xedb88320 : crc >> 1;
                table[i] = crc;
            }
            return table;
        }
    }

    /// <summary>The clock of a publisher on another machine, by the fastest message.</summary>
    internal sealed class ProximityForeignClock
    {
        private const long Second = ProximityLayout.JumpNs, Drift = ProximityLayout.NsPerDrift;
        public bool IsCertain;
        private bool isHeard, hasFormer;
        private ulong session;
        private long offset, seen, first, firstOffset, sent, former, formerSeen;

        public void Hear(ulong ofSession, long sentNs, long now)
        {
            long late = now - sentNs, fastest = offset + Math.Max(now - seen, 0) / Drift;
            long pace = ProximityLayout.PaceNs + Math.Max(now - first, 0) / Drift;
            bool isNewRun = ofSession != session;
            session = ofSession;
            if (!isHeard || sentNs < sent - ProximityLayout.BackNs || (isNewRun && late > fastest + Second))
            {
                long before = hasFormer ? former + Math.Max(now - formerSeen, 0) / Drift : late;
                hasFormer = false;
                Begin(late > before && late <= before + Second ? before : late, now);
            }
            else if (late < firstOffset - pace)
            {
                if (IsCertain)
                {
                    hasFormer = true;
                    former = offset;
                    formerSeen = seen;
                }
                Begin(late, now);
            }
            else
            {
                offset = Math.Min(late, fastest);
                seen = now;
                if (late <= firstOffset + pace && now - first >= ProximityLayout.SettlingNs)
                {
                    IsCertain = true;
                    hasFormer = false;
                }
                sentNs = Math.Max(sentNs, sent);
            }
            sent = sentNs;
        }

        /// <summary>A lower estimate of the publisher's clock.</summary>
        public long Theirs(long now) { return isHeard ? now - offset + ProximityLayout.TransitNs : now; }

        private void Begin(long newOffset, long now)
        {
            isHeard = true;
            IsCertain = false;
            offset = firstOffset = newOffset;
            seen = first = now;
        }
    }

    /// <summary>Ageing of contacts.</summary>
    public static class ProximityAgeing
    {
        /// <summary>
        /// Widen a contact's bounds by the possible motion of finger and parts until then; its distance stays that
        /// of the pose.
        /// </summary>
        public static void Widen(ref ProximityContact c, long nowNs, double maxSpeed, double maxAcceleration)
        {
            bool isTracked = (c.Flags & ProximityContactFlag.Tracked) != 0;
            bool isGeometry = c.Source == ProximitySource.Geometry;
            double partSpeed = Larger(Length(c.PartVelocity), 0);
            double limit = maxSpeed + partSpeed;
            var relative = new ProximityVector(c.Velocity.X - c.PartVelocity.X, c.Velocity.Y - c.PartVelocity.Y,
                c.Velocity.Z - c.PartVelocity.Z);
            double going = isGeometry ? Length(relative) : Math.Abs(c.ApproachSpeed);
            // The uncertainty of that velocity, and the excess of other parts' velocities, are in the predictions.
            double lead = 1e-9 * (c.PredictedNs - c.PoseNs);
            double spread = c.PredictedUpper - c.PredictedLower - (isGeometry ? 0 : c.Upper - c.Lower);
            spread *= 0.5 / lead;
            bool isFinite = lead > 0 && spread < double.PositiveInfinity;
            spread = isFinite ? spread : 0;
            if (!(spread < maxSpeed)) // that of a finger that could reverse
                going = Larger(going, partSpeed);
            bool isKnown = (c.Flags & ProximityContactFlag.Predicted) != 0 && isFinite;
            double atFirst = isKnown ? going + spread : double.NaN;
            double atLast = isKnown ? limit + spread : Larger(limit, partSpeed + spread);
            c.AgeNs = nowNs - c.PoseNs;
            double elapsed = Math.Max(1e-9 * c.AgeNs, 0);
            double drift = Lesser(atFirst + 0.5 * maxAcceleration * elapsed, atLast) * elapsed;
            c.Lower = c.PredictedLower = c.Lower - drift;
            c.Upper = c.PredictedUpper = c.Upper + drift;
            double ever = Math.Max(limit + spread, 2.2250738585072014e-308);
            double free = elapsed + Math.Max(c.Lower, 0) / ever; // Math.Max and Min keep nan
            c.TimeToContactLower = Math.Min(c.TimeToContactLower, free);
            c.PredictedDistance = c.SignedDistance;
            c.PredictedNs = nowNs;
            c.ContactBendError += double.PositiveInfinity;
            c.ForceIsValid = 0;
            c.Flags &= ~(ProximityContactFlag.Exact | ProximityContactFlag.Skipped | ProximityContactFlag.Predicted
                | ProximityContactFlag.ContactFound);
            c.Flags |= isTracked ? ProximityContactFlag.Bounded : ProximityContactFlag.None;
        }

        /// <summary>Reset a contact, except its finger, source and instant.</summary>
        public static void Forget(ref ProximityContact c)
        {
            var nowhere = new ProximityVector(double.NaN, double.NaN, double.NaN);
            c.Position = c.Velocity = c.PointOnFinger = c.PointOnPart = c.Normal = c.PartVelocity = nowhere;
            c.SignedDistance = c.ApproachSpeed = c.PredictedDistance = c.TimeToContact = double.NaN;
            c.Bend = c.BendRate = c.ContactBend = c.ContactBendError = c.ContactBendRate = double.NaN;
            c.Stiffness = c.Damping = c.Force = double.NaN;
            c.Lower = c.PredictedLower = double.NegativeInfinity;
            c.Upper = c.PredictedUpper = double.PositiveInfinity;
            c.TimeToContactLower = 0;
            c.Flags = ProximityContactFlag.None;
            c.Part = c.Face = -1;
            c.Surface = ProximitySurface.Unknown;
            c.Mode = ProximityMode.Hold;
            c.ForceIsValid = 0;
        }

        private static double Length(ProximityVector a) { return Math.Sqrt(a.X * a.X + a.Y * a.Y + a.Z * a.Z); }
        // These ignore nan.
        private static double Larger(double a, double b) { return double.IsNaN(a) ? b : double.IsNaN(b) || a > b ? a : b; }
        private static double Lesser(double a, double b) { return double.IsNaN(a) ? b : double.IsNaN(b) || a < b ? a : b; }
    }

    /// <summary>Validates frames and ages the newest; without a network. Instants are of this machine's
    /// clock.</summary>
    public unsafe class ProximityFrameReader
    {
        public readonly ProximityCounts Counts = new ProximityCounts();
        /// <summary>The state of the newest frame, or worse; at the last reading, like all that follows.</summary>
        public ProximityState State { get; private set; }
        public bool IsNew { get; private set; }
        public long NowNs { get; private set; } // on the publisher's clock
        public long AgeNs { get; private set; } // since the oldest pose; -1: no frame yet
        public ProximityFrameHeader Header; // as it was published; zeros: no frame yet
        public ProximityContact[] Contacts = new ProximityContact[0]; // aged: LATE has widening bounds, STALE no values
        /// <summary>Changes, additions, deformations and moves that the service has refused.</summary>
        public ulong Refused { get; private set; }
        /// <summary>The last of them: its kind and the reason.</summary>
        public string Refusal { get; private set; }
        public bool IsValid { get { return State == ProximityState.Ok || State == ProximityState.Degraded; } }

        private readonly bool isShared, isKeyed;
        private readonly long staleAfterNs;
        private readonly double maxSpeed, maxAcceleration;
        private readonly ProximityForeignClock clock = new ProximityForeignClock();
        private readonly List<ulong> endedSessions = new List<ulong>((int)ProximityLayout.MaxRuns + 1);
        private readonly List<ulong> endedNumbers = new List<ulong>((int)ProximityLayout.MaxRuns + 1);
        private ProximityContact[] held = new ProximityContact[0], candidate = new ProximityContact[0];
        private ProximityContact[] valid = new ProximityContact[0]; // the newest of each finger, while parts keep their numbers
        private ProximityFrameHeader arrived;
        private bool hasFrame, isFresh;
        private ulong lastSession, lastSequence, newestSession;
        private long lastSent, lastNow;
        private readonly Dictionary<long, string> labels = new Dictionary<long, string>(); // not all have come
        private ProximityDescriptionHeader labelsOf, namesOf; // namesOf: zeros before the first description
        private string[] partNames = new string[0];

        public ProximityFrameReader(bool sharesClock, bool isKeyed, double staleAfter = 0.08, double maxSpeed = 3,
            double maxAcceleration = 120)
        {
            State = ProximityState.Stale;
            Refusal = "";
            AgeNs = -1;
            isShared = sharesClock;
            this.isKeyed = isKeyed;
            staleAfterNs = (long)Math.Round(1e9 * staleAfter);
            this.maxSpeed = maxSpeed;
            this.maxAcceleration = maxAcceleration;
        }

        /// <summary>Read a frame, or a description, that arrived; return its defect.</summary>
        public ProximityFlaw Offer(byte[] message, int size, long nowNs)
        {
            ProximityFlaw flaw = IsDescription(message, size) ? Describe(message, size) : Judge(message, size, nowNs);
            if (flaw != ProximityFlaw.None)
                Counts.Flawed[(int)flaw]++;
            return flaw;
        }

        /// <summary>Set the state at an instant.</summary>
        public ProximityState At(long nowNs)
        {
            bool isBelieved = isShared || clock.IsCertain;
            NowNs = isShared ? nowNs : clock.Theirs(nowNs);
            IsNew = isFresh;
            isFresh = false;
            if (!hasFrame)
                return State;
            long expires = Math.Min(Header.ValidUntilNs, Header.PoseNs + ProximityLayout.MaxValidNs);
            State = Header.State;
            if (!isBelieved || (NowNs > expires && NowNs - staleAfterNs > expires))
                State = State > ProximityState.Stale ? State : ProximityState.Stale;
            else if (NowNs > expires)
                State = State > ProximityState.Late ? State : ProximityState.Late;
            AgeNs = Math.Max(NowNs - Header.PoseNs, 0);
            if (Contacts.Length != held.Length)
                Contacts = new ProximityContact[held.Length];
            Array.Copy(held, Contacts, held.Length);
            bool isUsed = State == ProximityState.Late && Header.State != ProximityState.Starting;
            for (int i = 0; i < Contacts.Length && !IsValid; i++)
            {
                if (isUsed)
                    ProximityAgeing.Widen(ref Contacts[i], NowNs, maxSpeed, maxAcceleration);
                else
                    ProximityAgeing.Forget(ref Contacts[i]);
            }
            return State;
        }

        /// <summary>
        /// Find the newest valid contact of a finger, as published, whose pose is at most that old, in seconds, at the
        /// last reading; return whether there is one. For a display, while frames are late.
        /// </summary>
        public bool LastValid(int finger, out ProximityContact contact, double atMost = 0.1)
        {
            bool isKnown = finger >= 0 && finger < valid.Length && (isShared || clock.IsCertain);
            contact = isKnown ? valid[finger] : default(ProximityContact);
            return (contact.Flags & ProximityContactFlag.Tracked) != 0 && NowNs - contact.PoseNs <= 1e9 * atMost;
        }

        /// <summary>
        /// The name of a part of the newest frame, which numbers it as Part of a contact; "" until it is known,
        /// within a tenth of a second of the first frame and of each change.
        /// </summary>
        public string PartName(int part)
        {
            bool isOfFrame = hasFrame && namesOf.Session == Header.Session && namesOf.Epoch == Header.Epoch;
            return isOfFrame && part >= 0 && part < partNames.Length ? partNames[part] : "";
        }

        private static bool IsDescription(byte[] message, int size)
        {
            return size >= sizeof(ProximityPrefix) && BitConverter.ToUInt32(message, 0) == ProximityLayout.DescriptionMagic;
        }

        /// <summary>
        /// Read one message of a description, whose names are used once it is complete. Known names make no
        /// garbage.
        /// </summary>
        private ProximityFlaw Describe(byte[] message, int size)
        {
            ProximityFlaw flaw = Check(message, size, ProximityLayout.DescriptionMagic, DescriptionCountAt,
                sizeof(ProximityDescriptionHeader), sizeof(ProximityLabel));
            if (flaw != ProximityFlaw.None)
                return flaw;
            fixed (byte* bytes = message)
            {
                ProximityDescriptionHeader of = *(ProximityDescriptionHeader*)bytes;
                long total = (long)of.PartCount + of.FingerCount;
                if (total > ProximityLayout.MaxNames || (long)of.First + of.Count > total)
                    return ProximityFlaw.Content;
                if (of.Refused != Refused)
                    Refusal = TextAt(message, RefusalAt, RefusalBytes);
                Refused = of.Refused;
                if (IsOfSame(of, namesOf))
                    return ProximityFlaw.None;
                if (!IsOfSame(of, labelsOf) || of.First == 0)
                    labels.Clear();
                labelsOf = of;
                var records = (ProximityLabel*)(bytes + sizeof(ProximityDescriptionHeader));
                for (int i = 0; i < of.Count; i++)
                    labels[(long)of.First + i] = TextAt(message, (int)((byte*)(records + i) - bytes), 64);
                if (labels.Count == total)
                    TakeNames(of);
            }
            return ProximityFlaw.None;
        }

        private static bool IsOfSame(ProximityDescriptionHeader a, ProximityDescriptionHeader b)
        {
            return a.Session == b.Session && a.Epoch == b.Epoch && a.PartCount == b.PartCount
                && a.FingerCount == b.FingerCount;
        }

        private static string TextAt(byte[] message, int first, int most)
        {
            int end = Array.IndexOf(message, (byte)0, first, most);
            return Encoding.UTF8.GetString(message, first, end < 0 ? most : end - first);
        }

        private void TakeNames(ProximityDescriptionHeader of)
        {
            namesOf = of;
            partNames = new string[of.PartCount];
            for (int row = 0; row < partNames.Length; row++)
                partNames[row] = labels[row];
        }

        private ProximityFlaw Judge(byte[] message, int size, long nowNs)
        {
            ProximityFlaw flaw = Unpack(message, size);
            if (flaw == ProximityFlaw.None && IsOld(nowNs))
                flaw = ProximityFlaw.Old;
            if (flaw == ProximityFlaw.None)
                flaw = ContentFlaw(isShared ? nowNs : arrived.PublishNs);
            if (flaw == ProximityFlaw.None)
                Accept(nowNs);
            return flaw;
        }

        private static readonly int FrameCountAt = (int)Marshal.OffsetOf(typeof(ProximityFrameHeader), "Count");
        private static readonly int RefusalAt = (int)Marshal.OffsetOf(typeof(ProximityDescriptionHeader), "Refusal");
        private static readonly int RefusalBytes = sizeof(ProximityDescriptionHeader) - RefusalAt;
        private static readonly int DescriptionCountAt = (int)Marshal.OffsetOf(typeof(ProximityDescriptionHeader), "Count");

        /// <summary>The defect of a message, except of its values; the number of records is at *countAt*.</summary>
        private static ProximityFlaw Check(byte[] message, int size, uint magic, int countAt, int headerSize, int recordSize)
        {
            int count = (size - headerSize) / recordSize;
            if (size < headerSize)
                return ProximityFlaw.Short;
            fixed (byte* bytes = message)
            {
                var prefix = (ProximityPrefix*)bytes;
                if (prefix->Magic != magic)
                    return ProximityFlaw.Magic;
                if (prefix->Version != ProximityLayout.Version)
                    return ProximityFlaw.Version;
                if (prefix->Size != size || prefix->HeaderSize != headerSize || headerSize + count * recordSize != size
                    || count > ProximityLayout.MaxRecords)
                    return ProximityFlaw.Size;
                if (ProximityKey.Crc32(message, ProximityLayout.CheckedFrom, size) != prefix->Checksum)
                    return ProximityFlaw.Checksum;
                return *(uint*)(bytes + countAt) == count ? ProximityFlaw.None : ProximityFlaw.Size;
            }
        }

        private ProximityFlaw Unpack(byte[] message, int size)
        {
            ProximityFlaw flaw = Check(message, size, ProximityLayout.FrameMagic, FrameCountAt,
                sizeof(ProximityFrameHeader), sizeof(ProximityContact));
            if (flaw != ProximityFlaw.None)
                return flaw;
            fixed (byte* bytes = message)
            {
                arrived = *(ProximityFrameHeader*)bytes;
                if (candidate.Length != arrived.Count)
                    candidate = new ProximityContact[arrived.Count];
                var contacts = (ProximityContact*)(bytes + sizeof(ProximityFrameHeader));
                for (int i = 0; i < candidate.Length; i++)
                    candidate[i] = contacts[i];
            }
            return ProximityFlaw.None;
        }

        private bool IsOld(long now)
        {
            if (isKeyed && arrived.Session < newestSession)
                return true; // of an earlier run: with a key it may be a recording
            if (!hasFrame)
                return false;
            if (arrived.Session == lastSession)
                return arrived.Sequence <= lastSequence || arrived.Sequence - lastSequence > ProximityLayout.MaxSkipped;
            int run = endedSessions.IndexOf(arrived.Session);
            if (arrived.Session > lastSession && run < 0)
                return false;
            bool isSilent = now - lastNow > ProximityLayout.RestartSilenceNs;
            if (run >= 0)
                return !(isSilent && arrived.Sequence > endedNumbers[run]);
            return !(isShared ? arrived.PublishNs > lastSent : isSilent);
        }

        private ProximityFlaw ContentFlaw(long baseNs)
        {
            if (arrived.State > ProximityState.Stopping || arrived.Source > ProximitySource.Held)
                return ProximityFlaw.Content;
            const long Most = ProximityLayout.LastNs - ProximityLayout.AheadNs;
            long latest = Math.Min(baseNs, Most) + ProximityLayout.AheadNs;
            if (arrived.PoseNs > latest || arrived.PublishNs > latest)
                return ProximityFlaw.Future;
            if (arrived.PoseNs < 0 || arrived.PublishNs < 0)
                return ProximityFlaw.Content;
            for (int i = 0; i < candidate.Length; i++)
                if (!IsSound(ref candidate[i], latest))
                    return ProximityFlaw.Content;
            return ProximityFlaw.None;
        }

        private bool IsSound(ref ProximityContact c, long latest)
        {
            if (c.Surface > ProximitySurface.Deformable || c.Mode > ProximityMode.Hold
                || c.Source > ProximitySource.Held || c.ForceIsValid > 1)
                return false;
            if ((c.Flags & ProximityContactFlag.Tracked) == 0)
                return true;
            const double Shortest = 1 - ProximityLayout.UnitError, Longest = 1 + ProximityLayout.UnitError;
            bool isUnknown = double.IsNaN(c.Position.X) || double.IsNaN(c.Position.Y) || double.IsNaN(c.Position.Z);
            bool isPlaced = IsFinite(c.Position.X) && IsFinite(c.Position.Y) && IsFinite(c.Position.Z);
            double n = c.Normal.X * c.Normal.X + c.Normal.Y * c.Normal.Y + c.Normal.Z * c.Normal.Z;
            return c.Lower <= c.SignedDistance && c.SignedDistance <= c.Upper && c.PredictedLower <= c.PredictedUpper
                && !double.IsNaN(c.PredictedDistance) && c.TimeToContactLower <= c.TimeToContact
                && (isPlaced || (isUnknown && c.Source != ProximitySource.Geometry))
                && !(n < Shortest * Shortest || n > Longest * Longest) // nan: no normal
                && c.PoseNs >= arrived.PoseNs && c.PoseNs <= latest;
        }

        private static bool IsFinite(double x) { return !double.IsNaN(x) && !double.IsInfinity(x); }

        private void Accept(long now)
        {
            ulong expected = arrived.Sequence; // no message is missing before the first
            if (hasFrame && lastSession == arrived.Session)
            {
                expected = lastSequence + 1;
            }
            else
            {
                Counts.Sessions++;
                if (hasFrame)
                    expected = Follow();
            }
            ulong missing = arrived.Sequence - expected;
            Counts.Lost += missing <= ProximityLayout.MaxSkipped ? missing : 0; // of a run that was joined late
            Counts.Received++;
            if (!isShared)
                clock.Hear(arrived.Session, arrived.PublishNs, now);
            lastSession = arrived.Session;
            lastSequence = arrived.Sequence;
            lastSent = arrived.PublishNs;
            lastNow = now;
            newestSession = Math.Max(newestSession, arrived.Session);
            if (arrived.Session != Header.Session || arrived.Epoch != Header.Epoch || valid.Length != candidate.Length)
                valid = new ProximityContact[candidate.Length];
            Header = arrived;
            ProximityContact[] spare = held;
            held = candidate;
            candidate = spare;
            hasFrame = isFresh = true;
            for (int i = 0; i < held.Length; i++)
                if ((held[i].Flags & ProximityContactFlag.Tracked) != 0
                    && (Header.State == ProximityState.Ok || Header.State == ProximityState.Degraded))
                    valid[i] = held[i];
        }

        /// <summary>Store the run that another follows, and its next number.</summary>
        private ulong Follow()
        {
            ulong expected = 0;
            int run = endedSessions.IndexOf(arrived.Session);
            if (run >= 0)
            {
                expected = endedNumbers[run] + 1;
                endedSessions.RemoveAt(run);
                endedNumbers.RemoveAt(run);
            }
            endedSessions.Add(lastSession);
            endedNumbers.Add(lastSequence);
            if (endedSessions.Count > ProximityLayout.MaxRuns)
            {
                endedSessions.RemoveAt(0);
                endedNumbers.RemoveAt(0);
            }
            return expected;
        }
    }

    internal static class ProximitySockets
    {
        public static IPEndPoint End(string host, int port)
        {
            IPAddress address;
            if (!IPAddress.TryParse(host, out address) || address.AddressFamily != AddressFamily.InterNetwork)
                throw new ProximityServiceError("\"" + host + "\" is not an IPv4 address, expected one such as 127.0.0.1");
            if (port < 1 || port > 65535)
                throw new ProximityServiceError("port is " + port + ", expected one from 1 to 65535");
            return new IPEndPoint(address, port);
        }

        public static Socket Bound(IPEndPoint here)
        {
            var socket = new Socket(AddressFamily.InterNetwork, SocketType.Dgram, ProtocolType.Udp);
            try
            {
                socket.Blocking = false;
                socket.ReceiveBufferSize = 1 << 19;
                socket.Bind(here);
            }
            catch (SocketException failure)
            {
                socket.Close();
                throw new ProximityServiceError("cannot use " + here + " (" + failure.Message + ")");
            }
            return socket;
        }
    }

    /// <summary>Receives and validates frames: only the newest counts, with its present validity.</summary>
    public sealed class ProximitySubscriber : ProximityFrameReader, IDisposable
    {
        private readonly Socket socket;
        private readonly ProximityKey key;
        private readonly byte[] buffer = new byte[1 << 16], tag = new byte[ProximityKey.TagBytes];

        /// <summary>
        /// Listen at host:port: udp://host:port?key=keyFile. On loopback every program of this machine is heard;
        /// elsewhere only *from*, HOST:PORT, whose publisher has ?bind=HOST:PORT: asking each datagram for its
        /// sender would make garbage.
        /// </summary>
        public ProximitySubscriber(int port, string host = "127.0.0.1", string from = null, string keyFile = null,
            double staleAfter = 0.08, double maxSpeed = 3, double maxAcceleration = 120)
            : base(IsHere(host, from), keyFile != null, staleAfter, maxSpeed, maxAcceleration)
        {
            IPEndPoint here = ProximitySockets.End(host, port);
            if (from == null && !IPAddress.IsLoopback(here.Address))
                throw new ProximityServiceError(host + " can be reached by others, expected `from`, the HOST:PORT to listen to");
            IPEndPoint sender = from == null ? null : Sender(from);
            key = keyFile == null ? null : new ProximityKey(keyFile);
            socket = ProximitySockets.Bound(here);
            if (sender != null)
                socket.Connect(sender);
        }

        /// <summary>Read arrived messages and update the state; never waits, makes no garbage.</summary>
        public ProximityState Read()
        {
            int unused = 0;
            for (int taken = 0; taken < ProximityLayout.MaxAtOnce && unused < ProximityLayout.MaxFlawed; taken++)
            {
                SocketError error;
                int size = socket.Receive(buffer, 0, buffer.Length, SocketFlags.None, out error);
                if (error == SocketError.ConnectionReset || error == SocketError.ConnectionRefused)
                    continue; // an earlier datagram had no receiver
                if (error != SocketError.Success)
                    break;
                if (key != null && (size = key.Verified(buffer, size, tag)) == 0)
                {
                    Counts.Unverified++;
                    unused++;
                }
                else if (Offer(buffer, size, ProximityClock.Ns) != ProximityFlaw.None)
                {
                    unused++;
                }
            }
            return At(ProximityClock.Ns);
        }

        public void Dispose() { socket.Close(); }

        private static bool IsHere(string host, string from)
        {
            IPEndPoint end = from == null ? ProximitySockets.End(host, 1) : Sender(from);
            return ProximityClock.IsThatOfServices && IPAddress.IsLoopback(end.Address);
        }

        private static IPEndPoint Sender(string from)
        {
            int colon = from.LastIndexOf(':'), port;
            if (colon < 0 || !int.TryParse(from.Substring(colon + 1), out port))
                throw new ProximityServiceError("`from` is \"" + from + "\", expected HOST:PORT, where the publisher sends from");
            return ProximitySockets.End(from.Substring(0, colon), port);
        }
    }

    /// <summary>Sends poses of fingers, moves and changes of parts.</summary>
    public sealed unsafe class ProximityPublisher : IDisposable
    {
        private const int MaxBytes = 65507; // of a datagram over IPv4
        private readonly Socket socket;
        private readonly ProximityKey key;
        private readonly byte[] buffer = new byte[1 << 16];
        private readonly ulong[] sequences = new ulong[7];
        private ulong session;
        private long awakeNs;

        /// <summary>Messages for which the system had no buffer space.</summary>
        public long Lost { get; private set; }

        /// <summary>Send to host:port: udp://host:port?bind=bind&amp;key=keyFile.</summary>
        public ProximityPublisher(int port, string host = "127.0.0.1", string bind = null, string keyFile = null)
        {
            IPEndPoint there = ProximitySockets.End(host, port);
            if (bind == null && !IPAddress.IsLoopback(there.Address))
                throw new ProximityServiceError(host + " is not on this machine, expected `bind`, the address to send from");
            IPAddress here = ProximitySockets.End(bind ?? "127.0.0.1", 1).Address;
            key = keyFile == null ? null : new ProximityKey(keyFile);
            socket = ProximitySockets.Bound(new IPEndPoint(here, 0));
            socket.Connect(there);
            Begin();
        }

        /// <summary>A pose of now; velocity and bend are not known.</summary>
        public static ProximityPose PoseOf(uint finger, double x, double y, double z)
        {
            ProximityPose pose = ProximityPose.Begin();
            pose.Finger = finger;
            pose.PoseNs = ProximityClock.Ns;
            pose.Position = new ProximityVector(x, y, z);
            return pose;
        }

        /// <summary>A move of now: the part is at rest, not turned, with its origin there. Makes garbage: keep it.</summary>
        public static ProximityMove MoveOf(string name, double x, double y, double z)
        {
            ProximityMove move = ProximityMove.Begin();
            NamePart(move.Name, name);
            move.PoseNs = ProximityClock.Ns;
            move.Translation = new ProximityVector(x, y, z);
            move.Velocity = move.AngularVelocity = new ProximityVector(0, 0, 0);
            return move;
        }

        /// <summary>A change of a part: hide, show or remove it.</summary>
        public static ProximityChange ChangeOf(string name, ProximityPartAction action)
        {
            var change = new ProximityChange();
            NamePart(change.Name, name);
            change.Action = action;
            return change;
        }

        /// <summary>An addition: a file of a folder of `parts_from`, not turned, with its origin there.</summary>
        public static ProximityAddition AdditionOf(string name, string file, double x, double y, double z)
        {
            ProximityAddition addition = ProximityAddition.Begin();
            NamePart(addition.Name, name);
            PutText(addition.File, file, 192, "a file's name");
            addition.Translation = new ProximityVector(x, y, z);
            return addition;
        }

        private static void NamePart(byte* there, string name) { PutText(there, name, 64, "a part's name"); }

        private static void PutText(byte* there, string text, int most, string what)
        {
            byte[] bytes = Encoding.UTF8.GetBytes(text);
            if (bytes.Length == 0 || bytes.Length > most)
                throw new ProximityServiceError(what + " has " + bytes.Length + " bytes, expected 1 to " + most);
            for (int i = 0; i < bytes.Length; i++)
                there[i] = bytes[i];
        }

        public void Send(ProximityPose[] poses, int count) { Send(ProximityLayout.PosesMagic, 0, poses, count); }
        public void Send(ProximityMove[] moves, int count) { Send(ProximityLayout.MovesMagic, 1, moves, count); }
        public void Send(ProximityPathPose[] poses, int count) { Send(ProximityLayout.PathPosesMagic, 2, poses, count); }
        public void Send(ProximityGlovePose[] poses, int count) { Send(ProximityLayout.GlovePosesMagic, 3, poses, count); }
        public void Send(ProximityChange[] changes, int count) { Send(ProximityLayout.ChangesMagic, 4, changes, count); }
        public void Send(ProximityAddition[] additions, int count) { Send(ProximityLayout.AdditionsMagic, 5, additions, count); }
        /// <summary>All vertices of one part, 64 a record, in order.</summary>
        public void Send(ProximityDeformation[] part, int count) { Send(ProximityLayout.DeformationsMagic, 6, part, count); }

        public void Dispose() { socket.Close(); }

        private void Begin()
        {
            session = Math.Max((ulong)ProximityClock.CalendarNs, session + 1);
            Array.Clear(sequences, 0, sequences.Length);
            awakeNs = ProximityClock.CalendarNs - ProximityClock.Ns;
        }

        private void Send<T>(uint magic, int kind, T[] array, int count) where T : struct
        {
            ReadOnlySpan<byte> records = MemoryMarshal.AsBytes(new ReadOnlySpan<T>(array, 0, count));
            int size = sizeof(ProximityInputHeader) + records.Length;
            int most = MaxBytes - (key == null ? 0 : ProximityKey.TagBytes);
            if (size > most || count > ProximityLayout.MaxRecords)
                throw new ProximityServiceError("a message of " + size + " bytes does not fit into a datagram (expected at most "
                    + most + " bytes)");
            long before = awakeNs;
            awakeNs = ProximityClock.CalendarNs - ProximityClock.Ns;
            if (awakeNs - before > 1000000000)
                Begin(); // the machine was suspended, and its monotonic clock stopped
            var header = new ProximityInputHeader();
            header.Magic = magic;
            header.Version = ProximityLayout.Version;
            header.HeaderSize = (ushort)sizeof(ProximityInputHeader);
            header.Size = (uint)size;
            header.Session = session;
            header.Sequence = sequences[kind]++;
            header.SendNs = ProximityClock.Ns;
            header.Count = (uint)count;
            fixed (byte* bytes = buffer)
            {
                *(ProximityInputHeader*)bytes = header;
                records.CopyTo(new Span<byte>(bytes + sizeof(ProximityInputHeader), records.Length));
                ((ProximityPrefix*)bytes)->Checksum = ProximityKey.Crc32(buffer, ProximityLayout.CheckedFrom, size);
            }
            if (key != null)
            {
                key.Tag(buffer, size, buffer, size);
                size += ProximityKey.TagBytes;
            }
            SendDatagram(size);
        }

        private void SendDatagram(int size)
        {
            SocketError error;
            socket.Send(buffer, 0, size, SocketFlags.None, out error);
            if (error == SocketError.ConnectionRefused || error == SocketError.ConnectionReset)
                // An earlier datagram had no receiver, and this one was not sent for that reason.
                socket.Send(buffer, 0, size, SocketFlags.None, out error);
            if (error == SocketError.WouldBlock || error == SocketError.NoBufferSpaceAvailable)
                Lost++;
            else if (error != SocketError.Success && error != SocketError.ConnectionRefused
                && error != SocketError.ConnectionReset && error != SocketError.HostUnreachable)
                throw new ProximityServiceError("cannot send (" + error + ")");
        }
    }
}
