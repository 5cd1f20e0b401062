// Asks for pairs of parts and ticks a tracked part through the binding for C#; the bytes of all answers go to a file.
using System;
using System.IO;
using System.Runtime.InteropServices;
using Proximity;

public static class PairsProgram
{
    private static void Write<T>(BinaryWriter output, Span<T> answers) where T : struct
    {
        output.Write(MemoryMarshal.AsBytes(answers).ToArray());
    }

    public static int Main(string[] words)
    {
        using (var output = new BinaryWriter(File.Create(words[1])))
        {
            var scene = new ProximityScene(words[0]);
            var parts = new int[20];
            var answers = new ProximityClearance[10];
            int count = scene.ClosestPairs(parts, answers);
            Write(output, new Span<int>(parts, 0, 2 * count));
            Write(output, new Span<ProximityClearance>(answers, 0, count));
            count = scene.ClosestPairs(new Span<int>(parts, 0, 2), new Span<ProximityClearance>(answers, 0, 1), 0.5, 1);
            Write(output, new Span<int>(parts, 0, 2 * count));
            var depths = new[] { scene.Penetration(0, 1), scene.Penetration(0, 1, new ProximityVector(0, 0, 2), 0.1) };
            Write<ProximityPenetration>(output, depths);
            var pose = new double[16];
            scene.GetPose(1, pose);
            var settings = ProximityPartTrackerSettings.Default;
            settings.Tolerance = 0.05;
            int[] group = { 1, 2 };
            var tracker = new ProximityPartTracker(scene, group, 2, settings);
            int before = GC.CollectionCount(0);
            for (int k = 0; k < 40; k++)
            {
                pose[3] += 0.002;
                long now = 1000000000000 + 1000000 * k;
                if (k % 5 == 4)
                    tracker.Tick(pose, now, now + 300, new ProximityVector(1, 2, 3), new ProximityVector(0, 0, k));
                else
                    tracker.Tick(k % 5 == 3 ? default : pose, now, now + 300);
                Write<ProximityConnection>(output, tracker.Connections);
            }
            var alone = new ProximityPartTracker(scene, 0);
            scene.Dispose(); // its trackers keep it open
            for (int k = 0; k < 20000; k++)
                alone.Tick(default, k, k);
            Console.WriteLine("collections " + (GC.CollectionCount(0) - before));
            tracker.Reset();
            tracker.Dispose();
            alone.Dispose();
            try
            {
                scene.ClosestPairs(new int[3], answers);
            }
            catch (ProximityError error)
            {
                Console.WriteLine(error.Message);
            }
        }
        return 0;
    }
}
