// A part that the user imports while fingers are tracked: Imported PART.stl (binary, in mm). A thread builds the part,
// another moves it at 90 Hz, and this one ticks ten fingers at 1 kHz.
//
//   mcs -unsafe -langversion:latest Runtime/ProximityMessages.cs Runtime/Proximity.cs Examples~/Imported.cs -out:Imported.exe
using System;
using System.Diagnostics;
using System.IO;
using System.Threading;
using System.Threading.Tasks;
using Proximity;

public static class Imported
{
    private static long Now => Stopwatch.GetTimestamp() * (1000000000L / Stopwatch.Frequency);

    private static double Metres(byte[] bytes, int at) => 0.001 * BitConverter.ToSingle(bytes, at);

    private static ProximityScene ImportStl(string path)
    {
        byte[] bytes = File.ReadAllBytes(path);
        int count = BitConverter.ToInt32(bytes, 80);
        var vertices = new ProximityVector[3 * count];
        var faces = new int[3 * count];
        for (int k = 0; k < vertices.Length; k++)
        {
            int at = 84 + 50 * (k / 3) + 12 + 12 * (k % 3); // header; for each face normal, corners, two bytes
            vertices[k] = new ProximityVector(Metres(bytes, at), Metres(bytes, at + 4), Metres(bytes, at + 8));
            faces[k] = k;
        }
        return new ProximityScene("imported", vertices, faces);
    }

    private static void Move(ProximityScene scene, int part, CancellationToken stop)
    {
        for (int k = 0; !stop.WaitHandle.WaitOne(11); k++)
        {
            double cos = Math.Cos(0.05 * k), sin = Math.Sin(0.05 * k);
            scene.Post(part, new[] { cos, -sin, 0, 0, sin, cos, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 }, Now);
        }
    }

    public static void Main(string[] words)
    {
        ProximityVector[] corners = { new ProximityVector(-1, -1, -0.2), new ProximityVector(1, -1, -0.2),
            new ProximityVector(0, 1, -0.2) };
        var tips = new ProximityVector[10];
        for (int k = 0; k < tips.Length; k++)
            tips[k] = new ProximityVector(0.01 * k, 0, 0.05);
        using (var scene = new ProximityScene("floor", corners, new[] { 0, 1, 2 }))
        using (var tracker = new ProximityTracker(scene, tips.Length))
        using (var stop = new CancellationTokenSource())
        {
            Task<ProximityScene> import = Task.Run(() => ImportStl(words[0]));
            Task mover = null;
            int part = -1, ticksLeft = 1000;
            double nearest = double.PositiveInfinity;
            var instants = new long[tips.Length];
            for (long next = Now; ticksLeft > 0; next += 1000000)
            {
                if (part < 0 && import.IsCompleted)
                {
                    part = scene.Add(import.Result); // between two ticks; the tracker continues
                    mover = Task.Run(() => Move(scene, part, stop.Token));
                }
                ticksLeft -= part < 0 ? 0 : 1;
                Array.Fill(instants, Now);
                foreach (ProximityContact contact in tracker.Tick(tips, instants, instants[0]))
                    if (part >= 0 && contact.Part == part)
                        nearest = Math.Min(nearest, contact.SignedDistance);
                Thread.Sleep((int)Math.Max(0, (next + 1000000 - Now) / 1000000));
            }
            stop.Cancel();
            mover.Wait();
            scene.Remove(part);
            Console.WriteLine($"came within {1e3 * nearest:F3} mm of 'imported', now {scene.PartCount} part");
        }
    }
}
