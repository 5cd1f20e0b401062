// Example.cs: a fingertip that descends on the sample bracket, and the service's answers, in a console.
//
//   mcs -unsafe ProximityMessages.cs ProximityClient.cs Example.cs && mono ProximityMessages.exe 9100 9101 5
//   (or: dotnet run, with <AllowUnsafeBlocks>true</AllowUnsafeBlocks>)
//
// The scene file has `publish = ["udp://127.0.0.1:9100"]` in [service] and `poses = "udp://127.0.0.1:9101"` in
// [input], both with `?key=KEY` if there is one. In Unity use ProximityHand.cs instead.
#if !UNITY_5_3_OR_NEWER
using System;
using System.Globalization;
using System.Text;
using System.Threading;
using Proximity;

public static class Example
{
    private static void Show(ProximitySubscriber frames)
    {
        var line = new StringBuilder(frames.AgeNs < 0 ? "no frame yet" : frames.State.ToString().ToUpperInvariant());
        foreach (ProximityContact contact in frames.Contacts)
        {
            if ((contact.Flags & ProximityContactFlag.Tracked) == 0)
                continue; // unknown: remove the hand's force
            // While the frame is valid the distance holds; LATE, only that it is at least the lower bound.
            line.AppendFormat(CultureInfo.InvariantCulture, "; finger {0}: {1} {2:F3} mm, pose {3:F1} ms old",
                contact.Finger, frames.IsValid ? "at" : "at least", 1e3 * contact.Lower, 1e-6 * contact.AgeNs);
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
            using (var frames = new ProximitySubscriber(int.Parse(words[0]), keyFile: key))
            using (var poses = new ProximityPublisher(int.Parse(words[1]), keyFile: key))
            {
                double pictures = 90 * double.Parse(words[2], CultureInfo.InvariantCulture); // 90 a second
                var hand = new ProximityPose[1];
                long began = ProximityClock.Ns;
                for (int picture = 1; picture <= pictures; picture++)
                {
                    // From 60 mm down at 5 mm a second, until the fingertip of 7 mm is 1 mm inside the foot.
                    hand[0] = ProximityPublisher.PoseOf(0, 0.050, 0.020, Math.Max(0.060 - 0.005 * picture / 90, 0.010));
                    poses.Send(hand, 1);
                    long left = began + picture * 1000000000L / 90 - ProximityClock.Ns;
                    Thread.Sleep((int)Math.Max(left / 1000000, 0)); // draw here
                    frames.Read(); // never waits
                    if (picture % 9 == 0)
                        Show(frames);
                }
                Console.WriteLine(frames.Counts);
            }
        }
        catch (ProximityServiceError failure)
        {
            Console.Error.WriteLine("example: " + failure.Message);
            return 1;
        }
        return 0;
    }
}
#endif
