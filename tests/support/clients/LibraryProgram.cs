// Queries a scene through the binding for C#: reads points from a file, and writes the bytes of all results to another.
using System;
using System.IO;
using System.Runtime.InteropServices;
using Proximity;

public static class LibraryProgram
{
    private const double Far = ProximityScene.Unlimited;

    private static void Write<T>(BinaryWriter output, Span<T> answers) where T : struct
    {
        output.Write(MemoryMarshal.AsBytes(answers).ToArray());
    }

    private static void AskAll(ProximityScene scene, ProximityVector[] points, ProximityVector[] others, BinaryWriter output,
        int[] ignored = null)
    {
        int count = points.Length;
        var numbers = new double[count];
        var nearest = new ProximityClosestPoint[count];
        scene.Closest(points, nearest, Far, ignored);
        Write<ProximityClosestPoint>(output, nearest);
        nearest[0] = scene.Closest(points[0], Far, ignored);
        scene.Closest(new ReadOnlySpan<ProximityVector>(points, 1, count - 1), new Span<ProximityClosestPoint>(nearest, 1, count - 1), 0.01, ignored);
        Write<ProximityClosestPoint>(output, nearest);
        scene.SignedDistance(points, numbers, ignored);
        Write<double>(output, numbers);
        scene.Distance(points, numbers, ignored);
        Write<double>(output, numbers);
        var isInside = new bool[count];
        scene.Contains(points, isInside, ignored);
        Write<bool>(output, isInside);
        var hits = new ProximityRayHit[count];
        scene.Cast(points, others, hits, 0.2, ignored);
        Write<ProximityRayHit>(output, hits);
        var segments = new ProximitySegmentHit[count];
        scene.ClosestToSegments(points, others, segments, Far, ignored);
        Write<ProximitySegmentHit>(output, segments);
        var pose = new double[16];
        scene.GetPose(0, pose);
        Write<double>(output, pose);
        var corners = new ProximityVector[2];
        scene.GetBounds(out corners[0], out corners[1]);
        Write<ProximityVector>(output, corners);
    }

    private static void Tick(ProximityScene scene, ProximityVector[] points, double[] pose, BinaryWriter output)
    {
        ProximityTrackerSettings settings = ProximityTrackerSettings.Default;
        settings.Radius = 0.004;
        using (var tracker = new ProximityTracker(scene, 2, settings))
        {
            tracker.SetRadius(1, 0.002);
            for (int k = 0; k < 6; k++)
            {
                if (k == 2 || k == 4)
                    tracker.Ignore(1, 1, k == 2);
                if (k == 3)
                    scene.Post(0, pose, 0); // like Move
                if (k == 4)
                    scene.SetSurface(0, 700, 0.5);
                var at = new ReadOnlySpan<ProximityVector>(points, k, 2);
                var pathEnds = new ReadOnlySpan<ProximityVector>(points, 10 + k, 4);
                var instants = new[] { 1000000000L + 1000000 * k, 1000000500L + 1000000 * k };
                Write<ProximityContact>(output, k % 2 == 0 ? tracker.Tick(at, instants, 1000001000L + 1000000 * k)
                    : tracker.Tick(at, instants, 1000001000L + 1000000 * k, at, pathEnds, new[] { 0.1, 0.2 }, new[] { 0.0, 2.0 }));
            }
        }
    }

    private static void Tell(Action wrong)
    {
        try
        {
            wrong();
        }
        catch (ProximityError error)
        {
            Console.WriteLine(error.Code + " " + error.Message);
        }
    }

    public static int Main(string[] words)
    {
        ProximityVector[] rows = MemoryMarshal.Cast<byte, ProximityVector>(File.ReadAllBytes(words[1])).ToArray();
        var points = new ReadOnlySpan<ProximityVector>(rows, 0, rows.Length / 2).ToArray();
        var others = new ReadOnlySpan<ProximityVector>(rows, rows.Length / 2, rows.Length / 2).ToArray();
        using (var output = new BinaryWriter(File.Create(words[2])))
        using (var scene = new ProximityScene(words[0]))
        using (var copy = new ProximityScene(File.ReadAllBytes(words[0])))
        {
            double[] pose = { 0, -1, 0, 0.1, 1, 0, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1 };
            AskAll(scene, points, others, output);
            copy.Move(new[] { 0 }, pose, new[] { points[0] });
            copy.Hide(copy.Find(words[3]));
            AskAll(copy, points, others, output);
            AskAll(scene, points, others, output, new[] { scene.Find(words[3]) });
            Tick(scene, points, pose, output);
            Console.WriteLine(scene.PartCount + " " + scene.NameOf(scene.Find(words[3])) + " " + scene.Find("none")
                + " '" + scene.NameOf(-1) + "'");
            Tell(() => new ProximityScene("none.prox"));
            Tell(() => new ProximityScene(new byte[64]));
            Tell(() => scene.Hide(7777));
            Tell(() => scene.Move(0, new double[16]));
            Tell(() => scene.Post(0, new double[16], 0));
            scene.Take(0);
            using (var meshes = new ProximityScene())
            {
                ProximityVector[] corners = { default, new ProximityVector(1, 0, 0), new ProximityVector(0, 1, 0) };
                int[] faces = { 0, 1, 2 };
                Tell(() => meshes.Distance(points, new double[points.Length]));
                meshes.Add("sheet", corners, faces);
                Console.WriteLine(meshes.Add("lid", corners, faces, pose) + " " + meshes.SignReason(0));
                Tell(() => meshes.Add("lid", corners, faces));
                Tell(() => meshes.Add("torn", corners, new[] { 0, 1, 9 }));
                meshes.Remove(0);
                Console.WriteLine(meshes.PartCount + " " + meshes.NameOf(0));
            }
            Tell(() => scene.Distance(points, new double[3]));
            Tell(() => scene.Closest(points[0], -1));
            Tell(() => new ProximityTracker(scene, 0));
            var left = new ProximityTracker(scene, 1);
            var (one, distance, instants) = (new ProximityVector[1], new double[1], new long[1]);
            scene.Dispose(); // its tracker keeps it open
            int before = GC.CollectionCount(0);
            for (int k = 0; k < 200000; k++)
            {
                copy.SignedDistance(one, distance);
                copy.Closest(points[0]);
                if (k % 10 == 0)
                    left.Tick(one, instants, 0);
            }
            Console.WriteLine("collections " + (GC.CollectionCount(0) - before));
            left.Dispose();
        }
        return 0;
    }
}
