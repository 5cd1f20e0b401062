// Example.cs: a fingertip that comes down on the scene, and what the service says of it, in a console.
//
//   mcs -unsafe DecaffMessages.cs DecaffClient.cs Example.cs && mono DecaffMessages.exe 9100 9101 5
//   (or: dotnet run, with <AllowUnsafeBlocks>true</AllowUnsafeBlocks>)
//
// The scene file has `publish = ["udp://127.0.0.1:9100"]` in [service] and `poses = "udp://127.0.0.1:9101"` in
// [input], both with `?key=KEY` where there is one. In Unity use DecaffHand.cs instead.
#if !UNITY_5_3_OR_NEWER
using System;
using System.Globalization;
using System.Text;
using System.Threading;
using Decaff;

public static class Example
{
    private static void Show(DecaffSubscriber frames)
    {
        var line = new StringBuilder();
        line.AppendFormat(CultureInfo.InvariantCulture, "{0} age {1:F1} ms", frames.State.ToString().ToUpperInvariant(),
            1e-6 * frames.AgeNs);
        foreach (DecaffContact contact in frames.Contacts)
        {
            if ((contact.Flags & DecaffContactFlag.Tracked) == 0)
                continue; // nothing is known of it: take the hand's force away
            // While the frame is valid the distance holds; LATE, only that it is at least the lower bound.
            line.AppendFormat(CultureInfo.InvariantCulture, "; finger {0}: {1} {2:F3} mm", contact.Finger,
                frames.IsValid ? "at" : "at least", 1e3 * contact.Lower);
        }
        Console.WriteLine(line);
    }

    public static int Main(string[] words)
    {
        if (words.Length < 3)
        {
            Console.Error.WriteLine("example: expected FRAMES_PORT POSES_PORT SECONDS [KEY]");
            return 2;
        }
        try
        {
            string key = words.Length > 3 ? words[3] : null;
            using (var frames = new DecaffSubscriber(int.Parse(words[0]), keyFile: key))
            using (var poses = new DecaffPublisher(int.Parse(words[1]), keyFile: key))
            {
                double seconds = double.Parse(words[2], CultureInfo.InvariantCulture), gone = 0;
                var hand = new DecaffPose[1];
                for (long began = DecaffClock.Ns; gone < seconds; gone = 1e-9 * (DecaffClock.Ns - began))
                {
                    // From 60 mm above the origin's corner down to 40 mm, at 5 mm a second.
                    hand[0] = DecaffPublisher.PoseOf(0, 0.030, 0.010, Math.Max(0.060 - 0.005 * gone, 0.040));
                    poses.Send(hand, 1);
                    Thread.Sleep(10);
                    frames.Read();
                    Show(frames);
                }
                Console.WriteLine("received {0}, lost {1}", frames.Counts.Received, frames.Counts.Lost);
            }
        }
        catch (DecaffError failure)
        {
            Console.Error.WriteLine("example: " + failure.Message);
            return 1;
        }
        return 0;
    }
}
#endif
