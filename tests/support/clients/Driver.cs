// Command-line driver of the client in C#, see client_programs.py.
using System;
using System.Globalization;
using System.IO;
using System.Runtime.InteropServices;
using System.Threading;
using Proximity;

public static unsafe class Driver
{
    private static void ReadEvents(string from, string to)
    {
        using (var events = new BinaryReader(File.OpenRead(from)))
        using (var output = new BinaryWriter(File.Create(to)))
        {
            bool isShared = events.ReadByte() != 0, isKeyed = events.ReadByte() != 0;
            var reader = new ProximityFrameReader(isShared, isKeyed);
            while (events.BaseStream.Position < events.BaseStream.Length)
            {
                byte kind = events.ReadByte();
                long now = events.ReadInt64();
                if (kind == 1)
                {
                    int size = events.ReadInt32();
                    output.Write((byte)reader.Offer(events.ReadBytes(size), size, now));
                    continue;
                }
                output.Write((byte)reader.At(now));
                output.Write(reader.IsNew);
                output.Write(reader.NowNs);
                output.Write(reader.AgeNs);
                output.Write(reader.Contacts.Length);
                var bytes = new byte[sizeof(ProximityContact)];
                foreach (ProximityContact contact in reader.Contacts)
                {
                    fixed (byte* first = bytes)
                        *(ProximityContact*)first = contact;
                    output.Write(bytes);
                }
                for (int finger = 0; finger < reader.Contacts.Length; finger++)
                {
                    ProximityContact valid;
                    output.Write(reader.LastValid(finger, out valid));
                    fixed (byte* first = bytes)
                        *(ProximityContact*)first = valid;
                    output.Write(bytes);
                }
            }
            output.Write(reader.Counts.Received);
            output.Write(reader.Counts.Lost);
            output.Write(reader.Counts.Sessions);
            for (int part = -1; part < 4; part++)
                output.Write(System.Text.Encoding.UTF8.GetBytes(reader.PartName(part) + "\n"));
            output.Write(System.Text.Encoding.UTF8.GetBytes(reader.Refused + " " + reader.Refusal + "\n"));
        }
    }

    private static void PrintTags(string[] words)
    {
        var key = new ProximityKey(words[1]);
        byte[] data = File.ReadAllBytes(words[2]), tag = new byte[16];
        for (int i = 3; i < words.Length; i++)
        {
            key.Tag(data, int.Parse(words[i]), tag, 0);
            Console.WriteLine(BitConverter.ToString(tag).Replace("-", "").ToLowerInvariant());
        }
    }

    private static void Send(string[] words)
    {
        string bind = words[3] == "-" ? null : words[3], key = words[4] == "-" ? null : words[4];
        using (var publisher = new ProximityPublisher(int.Parse(words[2]), words[1], bind, key))
        {
            if (words.Length > 5)
                ProximityPublisher.MoveOf(new string('x', 65), 7, 8, 9);
            if (words[0] == "sender")
                publisher.Send(new ProximityPose[4096], 4096);
            ProximityPose[] poses = { ProximityPublisher.PoseOf(0, 1, 2, 3), ProximityPublisher.PoseOf(1, 4, 5, 6) };
            ProximityMove[] moves = { ProximityPublisher.MoveOf("lid \u00e4", 7, 8, 9) };
            publisher.Send(poses, 2);
            publisher.Send(moves, 1);
            ProximityChange[] changes = { ProximityPublisher.ChangeOf("lid \u00e4", ProximityPartAction.Hide) };
            publisher.Send(changes, 1);
            ProximityAddition[] additions = { ProximityPublisher.AdditionOf("lid \u00e4", "inner/lid.stl", 7, 8, 9) };
            publisher.Send(additions, 1);
            publisher.Send(poses, 2);
        }
    }

    private static void Listen(string[] words)
    {
        string from = words[3] == "-" ? null : words[3], key = words[4] == "-" ? null : words[4];
        using (var subscriber = new ProximitySubscriber(int.Parse(words[2]), words[1], from, key))
        {
            Console.WriteLine("listening");
            while (subscriber.Read() != ProximityState.Stopping)
            {
                if (subscriber.IsNew && subscriber.IsValid)
                    Console.WriteLine(string.Format(CultureInfo.InvariantCulture, "{0} {1:F6}",
                        subscriber.Contacts[0].Finger, subscriber.Contacts[0].SignedDistance));
                Thread.Sleep(1);
            }
            Console.WriteLine("received {0} unverified {1}", subscriber.Counts.Received, subscriber.Counts.Unverified);
        }
    }

    /// <summary>Print the number of garbage collections while reading many frames and sending many poses.</summary>
    private static void CountGarbage(string[] words)
    {
        int port = int.Parse(words[1]);
        byte[] frame = File.ReadAllBytes(words[2]);
        var reader = new ProximityFrameReader(true, false);
        long first = long.Parse(words[3]);
        using (var publisher = new ProximityPublisher(port))
        using (var subscriber = new ProximitySubscriber(port))
        {
            var poses = new ProximityPose[5];
            int before = 0;
            for (int i = 0; i < 200100; i++)
            {
                if (i == 100)
                {
                    GC.Collect();
                    before = GC.CollectionCount(0);
                }
                publisher.Send(poses, 5);
                subscriber.Read(); // poses are not frames: rejected and counted
                fixed (byte* bytes = frame)
                {
                    ((ProximityPrefix*)bytes)->Sequence = (ulong)i;
                    ((ProximityPrefix*)bytes)->Checksum = ProximityKey.Crc32(frame, ProximityLayout.CheckedFrom, frame.Length);
                }
                reader.Offer(frame, frame.Length, first + i * 10000L);
                reader.At(first + i * 10000L);
            }
            Console.WriteLine("collections {0} refused {1} offered {2}", GC.CollectionCount(0) - before,
                subscriber.Counts.Flawed[(int)ProximityFlaw.Magic], reader.Counts.Received);
        }
    }

    public static int Main(string[] words)
    {
        try
        {
            if (words[0] == "read")
                ReadEvents(words[1], words[2]);
            else if (words[0] == "tag")
                PrintTags(words);
            else if (words[0] == "listen")
                Listen(words);
            else if (words[0] == "garbage")
                CountGarbage(words);
            else
                Send(words);
        }
        catch (ProximityServiceError failure)
        {
            Console.WriteLine(failure.Message);
            return 1;
        }
        return 0;
    }
}
