// Proximity.cs: the engine in the user's process, through the library in C. Functions are described in proximity.h.
//
// Made by `proximity library csharp`; edits are lost. Needs ProximityMessages.cs, "Allow unsafe code", spans
// (.NET Standard 2.1: Unity 2021.2 or newer), and the library for your system: libproximity.so, proximity.dll.
// Lengths are in metres, in the scene's right-handed frame; matrices are 16 numbers, row-major, "scene from part".
// Queries fill the caller's arrays and make no garbage. Any number of threads may query one scene at the same time;
// Move, Hide and Dispose must not run while another thread uses it. Errors are thrown as ProximityError.
using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Proximity
{
    /// <summary>An error as a sentence; the code is one of proximity.h.</summary>
    public sealed class ProximityError : Exception
    {
        public const int BadArgument = 1, NoMemory = 2, NoFile = 3, BadFile = 4, BadPose = 5, NoInside = 6, NoProcessor = 7,
            Broken = 8, BadVersion = 9, BadMesh = 10; // BadVersion: of a scene to be compiled again
        public readonly int Code;
        public ProximityError(int code, string sentence) : base(sentence) => Code = code;
    }

    public enum ProximityFeature { None = -1, Face, Edge, Vertex }

    /// <summary>The surface point nearest to a point; without one, Part is -1 and the distance infinite.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityClosestPoint
    {
        public double SignedDistance; // m, negative inside
        public ProximityVector Point, Gradient, Barycentric; // Gradient: unit, steepest increase of the signed distance
        public int Part, Face;
        public ProximityFeature Feature;
        private int isSigned;
        public bool IsSigned => isSigned != 0; // false: the part has no inside
    }

    /// <summary>The first hit of a ray; without one, Part is -1 and the distance infinite.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityRayHit
    {
        public double Distance; // m along the ray
        public ProximityVector Point, Normal, Barycentric; // Normal: unit, outward
        public int Part, Face;
    }

    /// <summary>The shortest connection between a segment and the surface.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ProximitySegmentHit
    {
        public double Distance; // m; 0 if they meet
        public ProximityVector PointOnSegment, PointOnSolid;
        public double Fraction; // position on the segment: 0 at its start, 1 at its end
        public ProximityVector Barycentric;
        public int Part, Face;
    }

    public enum ProximityRelation { Apart, Touching, Crossing, FirstInside, SecondInside }

    /// <summary>The shortest connection of two parts; the true distance is between Lower and Distance.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityClearance
    {
        public double Lower, Distance; // m; 0 unless the parts are apart, infinite beyond the limit
        public ProximityVector PointOnFirst, PointOnSecond;
        public int FaceOnFirst, FaceOnSecond;
        public ProximityRelation Relation;
        private readonly int unused;
    }

    /// <summary>Bounds of how deep two parts are in each other; 0 unless they overlap.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityPenetration
    {
        public double Depth, Lower; // m, way out: moved so far along Direction the first part is free; by less than Lower, not
        public ProximityVector Direction;
        public double Deepest, DeepestLower; // m: no point is farther inside; the deepest point is at least so far
        public ProximityVector DeepestPoint;
    }

    /// <summary>A connection of a tracked part; see proximity_tracker.h.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityConnection
    {
        public const uint Predicted = 2, Exact = 4, Bounded = 8, Skipped = 16, Inside = 64, InRange = 128, PartChanged = 256,
            Crossing = 4096; // of Flags
        public uint Flags, Work;
        public int Part, OwnPart, Face, OwnFace;
        public long PoseNs, AgeNs;
        public double Distance, Lower, Upper; // m
        public ProximityVector PointOnOwn, PointOnPart, Normal;
        public double ApproachSpeed; // m/s
        public long PredictedNs;
        public double PredictedDistance, PredictedLower, PredictedUpper;
        public double TimeToContact, TimeToContactLower; // s from the pose
        public double Depth, DepthLower; // m along the normal
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityPartTrackerSettings
    {
        public double WorkingRange, Tolerance, Latency, Horizon; // proximity_tracker.h
        public long Budget;
        public static ProximityPartTrackerSettings Default => Native.proximity_default_part_settings();
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ProximityTrackerSettings
    {
        public double Radius, Latency, WorkingRange, Tolerance, Horizon, MaxSpeed, MaxAcceleration; // proximity_tracker.h
        public long Budget;
        public static ProximityTrackerSettings Default => Native.proximity_default_settings();
    }

    /// <summary>A scene: a compiled one, "....prox", or parts that are added.</summary>
    public sealed unsafe class ProximityScene : IDisposable
    {
        public const double Unlimited = double.PositiveInfinity;
        internal readonly NativeHandle Handle = new NativeHandle();

        /// <summary>A scene without parts: add some before the first query.</summary>
        public ProximityScene()
        {
            IntPtr made;
            Native.CheckInterface();
            Native.Check(Native.proximity_new_scene(&made, out NativeError error), ref error);
            Handle.Take(made);
        }

        /// <summary>The bodies of a mesh: vertices in m, three numbers of vertices a face, counter-clockwise seen from
        /// outside. It uses no other scene: a separate thread may make it, and Add takes the parts over.</summary>
        public ProximityScene(string name, ReadOnlySpan<ProximityVector> vertices, ReadOnlySpan<int> faces)
        {
            IntPtr made;
            Native.CheckInterface();
            Native.Expect(faces.Length % 3 == 0);
            fixed (byte* text = Native.Utf8(name)) fixed (ProximityVector* points = vertices) fixed (int* rows = faces)
                Native.Check(Native.proximity_from_mesh(text, points, (UIntPtr)vertices.Length, rows,
                    (UIntPtr)(faces.Length / 3), &made, out NativeError error), ref error);
            Handle.Take(made);
        }

        public ProximityScene(string path)
        {
            IntPtr made;
            Native.CheckInterface();
            fixed (byte* text = Native.Utf8(path))
                Native.Check(Native.proximity_open(text, &made, out NativeError error), ref error);
            Handle.Take(made);
        }

        /// <summary>Open the bytes of such a file, which must remain unchanged until the scene is closed.</summary>
        public ProximityScene(byte[] content)
        {
            IntPtr made;
            Native.CheckInterface();
            Handle.Content = GCHandle.Alloc(content, GCHandleType.Pinned);
            void* bytes = (void*)Handle.Content.AddrOfPinnedObject();
            int code = Native.proximity_open_bytes(bytes, (UIntPtr)content.Length, &made, out NativeError error);
            if (code != 0)
                Handle.Content.Free();
            Native.Check(code, ref error);
            Handle.Take(made);
        }

        /// <summary>Close it; with open trackers, when the last is disposed of.</summary>
        public void Dispose() => Handle.Dispose();

        public int PartCount => Native.proximity_part_count(Handle);

        /// <summary>The name of a part; empty if the part does not exist.</summary>
        public string NameOf(int part) => Native.Text(Native.proximity_part_name(Handle, part));

        /// <summary>The part of a name; -1 if there is none.</summary>
        public int Find(string name)
        {
            fixed (byte* text = Native.Utf8(name))
                return Native.proximity_find_part(Handle, text);
        }

        public void GetPose(int part, Span<double> matrix)
        {
            Native.Expect(matrix.Length == 16);
            fixed (double* numbers = matrix)
                Native.Check(Native.proximity_pose(Handle, part, numbers, out NativeError error), ref error);
        }

        public void GetBounds(out ProximityVector lower, out ProximityVector upper)
        {
            lower = upper = default;
            fixed (ProximityVector* first = &lower, second = &upper)
                Native.proximity_bounds(Handle, first, second);
        }

        /// <summary>Add copies of the parts of another scene, at a pose times their own; the number of the first.</summary>
        public int Add(ProximityScene added, ReadOnlySpan<double> matrix = default)
        {
            int first;
            Native.Expect(matrix.IsEmpty || matrix.Length == 16);
            fixed (double* at = matrix)
                Native.Check(Native.proximity_add_scene(Handle, added.Handle, at, &first, out NativeError error), ref error);
            return first;
        }

        /// <summary>Add a mesh; the number of its part, or of the first of its bodies.</summary>
        public int Add(string name, ReadOnlySpan<ProximityVector> vertices, ReadOnlySpan<int> faces,
            ReadOnlySpan<double> matrix = default)
        {
            using (var added = new ProximityScene(name, vertices, faces))
                return Add(added, matrix);
        }

        /// <summary>The reason for the sign method of a part from a mesh; empty for parts of a compiled
        /// scene.</summary>
        public string SignReason(int part) => Native.Text(Native.proximity_sign_reason(Handle, part));

        /// <summary>Remove a part; the numbers of later parts decrease by one.</summary>
        public void Remove(int part) =>
            Native.Check(Native.proximity_remove(Handle, part, out NativeError error), ref error);

        /// <summary>Move parts, with velocities in m/s and rad/s; without them they are at rest.</summary>
        public void Move(ReadOnlySpan<int> parts, ReadOnlySpan<double> matrices,
            ReadOnlySpan<ProximityVector> velocities = default, ReadOnlySpan<ProximityVector> angularVelocities = default)
        {
            int count = parts.Length;
            Native.Expect(matrices.Length == 16 * count && (velocities.IsEmpty || velocities.Length == count)
                && (angularVelocities.IsEmpty || angularVelocities.Length == count));
            fixed (int* rows = parts) fixed (double* to = matrices)
            fixed (ProximityVector* linear = velocities, angular = angularVelocities)
                Native.Check(Native.proximity_move(Handle, rows, (UIntPtr)count, to, linear, angular,
                    out NativeError error), ref error);
        }

        public void Move(int part, ReadOnlySpan<double> matrix) => Move(new ReadOnlySpan<int>(&part, 1), matrix);

        /// <summary>Post the pose of a part from another thread than the one that ticks. The next tick applies the newest
        /// pose, extrapolated by its velocities (m/s and rad/s) to the instant of the fingers.</summary>
        public void Post(int part, ReadOnlySpan<double> matrix, long poseNs, ProximityVector velocity = default,
            ProximityVector angularVelocity = default)
        {
            Native.Expect(matrix.Length == 16);
            fixed (double* to = matrix)
                Native.Check(Native.proximity_post(Handle, part, to, poseNs, &velocity, &angularVelocity,
                    out NativeError error), ref error);
        }

        /// <summary>Apply posted poses for an instant, in programs without a tracker.</summary>
        public void Take(long instantNs) =>
            Native.Check(Native.proximity_take(Handle, instantNs, out NativeError error), ref error);

        /// <summary>Hide a part from all queries, or show it again.</summary>
        public void Hide(int part, bool isHidden = true) =>
            Native.Check(Native.proximity_hide(Handle, part, isHidden ? 1 : 0, out NativeError error), ref error);

        /// <summary>Set a part's response to contact, N/m and N s/m; 0: it is rigid.</summary>
        public void SetSurface(int part, double stiffness, double damping = 0) =>
            Native.Check(Native.proximity_set_surface(Handle, part, stiffness, damping, out NativeError error), ref error);

        // --- queries: an answer for each row; none is farther than the limit, m. Ignored parts are left out ---

        public void Closest(ReadOnlySpan<ProximityVector> points, Span<ProximityClosestPoint> answers,
            double limit = Unlimited, ReadOnlySpan<int> ignored = default) =>
            Ask(Question.Closest, points, default, answers, limit, ignored);

        public ProximityClosestPoint Closest(ProximityVector point, double limit = Unlimited,
            ReadOnlySpan<int> ignored = default)
        {
            ProximityClosestPoint answer;
            Closest(new ReadOnlySpan<ProximityVector>(&point, 1), new Span<ProximityClosestPoint>(&answer, 1), limit,
                ignored);
            return answer;
        }

        /// <summary>Signed distances, m: as Closest, and faster.</summary>
        public void SignedDistance(ReadOnlySpan<ProximityVector> points, Span<double> distances,
            ReadOnlySpan<int> ignored = default) =>
            Ask(Question.Signed, points, default, distances, Unlimited, ignored);

        /// <summary>Distances without sign, m: the fastest.</summary>
        public void Distance(ReadOnlySpan<ProximityVector> points, Span<double> distances,
            ReadOnlySpan<int> ignored = default) =>
            Ask(Question.Distance, points, default, distances, Unlimited, ignored);

        /// <summary>Whether points are inside a part.</summary>
        public void Contains(ReadOnlySpan<ProximityVector> points, Span<bool> isInside,
            ReadOnlySpan<int> ignored = default) =>
            Ask(Question.Contains, points, default, isInside, Unlimited, ignored);

        /// <summary>The first hits of rays; directions have any length but zero.</summary>
        public void Cast(ReadOnlySpan<ProximityVector> origins, ReadOnlySpan<ProximityVector> directions,
            Span<ProximityRayHit> answers, double limit = Unlimited, ReadOnlySpan<int> ignored = default) =>
            Ask(Question.Cast, origins, directions, answers, limit, ignored);

        /// <summary>The shortest connections between segments and the surface.</summary>
        public void ClosestToSegments(ReadOnlySpan<ProximityVector> starts, ReadOnlySpan<ProximityVector> ends,
            Span<ProximitySegmentHit> answers, double limit = Unlimited, ReadOnlySpan<int> ignored = default) =>
            Ask(Question.Segments, starts, ends, answers, limit, ignored);

        /// <summary>The shortest connection of two parts, within the tolerance.</summary>
        public ProximityClearance Clearance(int first, int second, double limit = Unlimited, double tolerance = 0,
            ulong budget = 0)
        {
            Native.Check(Native.proximity_clearance(Handle, first, second, limit, tolerance, (UIntPtr)budget,
                out ProximityClearance answer, out NativeError error), ref error);
            return answer;
        }

        /// <summary>The nearest pairs of visible parts, or of one part and others, the nearest first: two numbers of parts
        /// for each answer; as many as the arrays have space for. The number of pairs.</summary>
        public int ClosestPairs(Span<int> parts, Span<ProximityClearance> answers, double limit = Unlimited, int of = -1)
        {
            UIntPtr count;
            Native.Expect(parts.Length == 2 * answers.Length);
            fixed (int* rows = parts) fixed (ProximityClearance* to = answers)
                Native.Check(Native.proximity_closest_pairs(Handle, of, limit, (UIntPtr)answers.Length, rows, to, &count,
                    out NativeError error), ref error);
            return (int)count;
        }

        /// <summary>How deep two parts are in each other; without a direction, along one with a short way out.</summary>
        public ProximityPenetration Penetration(int first, int second, ProximityVector? direction = null,
            double tolerance = 0.01)
        {
            ProximityVector along = direction.GetValueOrDefault();
            Native.Check(Native.proximity_penetration(Handle, first, second, direction.HasValue ? &along : null, tolerance,
                out ProximityPenetration answer, out NativeError error), ref error);
            return answer;
        }

        private enum Question { Closest, Signed, Distance, Contains, Cast, Segments }

        private void Ask<T>(Question question, ReadOnlySpan<ProximityVector> rows, ReadOnlySpan<ProximityVector> others,
            Span<T> answers, double limit, ReadOnlySpan<int> ignored) where T : struct
        {
            Native.Expect(answers.Length == rows.Length && (others.IsEmpty || others.Length == rows.Length));
            UIntPtr count = (UIntPtr)rows.Length, k = (UIntPtr)ignored.Length;
            NativeError e;
            int code;
            fixed (ProximityVector* a = rows, b = others) fixed (byte* to = MemoryMarshal.AsBytes(answers))
            fixed (int* parts = ignored)
                code = question == Question.Closest
                        ? Native.proximity_closest_without(Handle, a, count, limit, parts, k, to, out e)
                    : question == Question.Signed
                        ? Native.proximity_signed_distance_without(Handle, a, count, parts, k, to, out e)
                    : question == Question.Distance
                        ? Native.proximity_distance_without(Handle, a, count, parts, k, to, out e)
                    : question == Question.Contains
                        ? Native.proximity_contains_without(Handle, a, count, parts, k, to, out e)
                    : question == Question.Cast
                        ? Native.proximity_cast_without(Handle, a, b, count, limit, parts, k, to, out e)
                    : Native.proximity_closest_to_segments_without(Handle, a, b, count, limit, parts, k, to, out e);
            Native.Check(code, ref e);
        }
    }

    /// <summary>Contacts of every fingertip at every tick. One thread at a time uses it.</summary>
    public sealed unsafe class ProximityTracker : IDisposable
    {
        public readonly ProximityContact[] Contacts; // of all fingers; overwritten by each tick
        private readonly NativeHandle handle = new NativeHandle();

        public ProximityTracker(ProximityScene scene, int fingers, ProximityTrackerSettings? settings = null)
        {
            IntPtr made;
            ProximityTrackerSettings chosen = settings ?? ProximityTrackerSettings.Default;
            Contacts = new ProximityContact[fingers];
            handle.Scene = scene.Handle;
            Native.Check(Native.proximity_create_tracker(scene.Handle, (UIntPtr)fingers, &chosen, &made,
                out NativeError error), ref error);
            handle.Take(made);
        }

        public void Dispose() => handle.Dispose();

        /// <summary>Reset all fingers: the next tick is treated as the first.</summary>
        public void Reset() => Native.proximity_reset_tracker(handle);

        /// <summary>Set the radius of one fingertip, m.</summary>
        public void SetRadius(int finger, double radius) =>
            Native.Check(Native.proximity_set_radius(handle, (UIntPtr)(uint)finger, radius, out NativeError e), ref e);

        /// <summary>Exclude a part, such as one that the hand holds, from the contacts of a finger, or include it again,
        /// from the next tick on.</summary>
        public void Ignore(int finger, int part, bool isIgnored = true) =>
            Native.Check(Native.proximity_ignore(handle, (UIntPtr)(uint)finger, part, isIgnored ? 1 : 0,
                out NativeError e), ref e);

        /// <summary>Compute the contacts of all fingers, a row each; a finger whose position is not finite is not
        /// tracked. Instants are ns of one clock, velocities m/s; paths have equal numbers of corners, stored by
        /// finger.</summary>
        public ProximityContact[] Tick(ReadOnlySpan<ProximityVector> positions, ReadOnlySpan<long> poseNs, long nowNs,
            ReadOnlySpan<ProximityVector> velocities = default, ReadOnlySpan<ProximityVector> corners = default,
            ReadOnlySpan<double> bends = default, ReadOnlySpan<double> pathBends = default)
        {
            int count = Contacts.Length, each = corners.Length / count;
            Native.Expect(positions.Length == count && poseNs.Length == count && corners.Length == each * count
                && (velocities.IsEmpty || velocities.Length == count) && (bends.IsEmpty || bends.Length == count)
                && (pathBends.IsEmpty || pathBends.Length == each));
            fixed (ProximityVector* at = positions, linear = velocities, first = corners) fixed (long* instants = poseNs)
            fixed (double* own = bends, along = pathBends) fixed (ProximityContact* to = Contacts)
            {
                var paths = new NativePaths { Corners = first, Count = (UIntPtr)each, OfCorners = along, OfFingers = own };
                Native.Check(Native.proximity_tick(handle, at, instants, nowNs, linear, first == null ? null : &paths, to,
                    out NativeError error), ref error);
            }
            return Contacts;
        }
    }

    /// <summary>The nearest connections of a part that moves, or of several that move together, to the rest of a scene.
    /// One thread at a time uses it; a tick moves parts of the scene.</summary>
    public sealed unsafe class ProximityPartTracker : IDisposable
    {
        public readonly ProximityConnection[] Connections; // the shortest first; overwritten by each tick
        private readonly NativeHandle handle = new NativeHandle { IsOfParts = true };

        public ProximityPartTracker(ProximityScene scene, ReadOnlySpan<int> parts, int connections = 1,
            ProximityPartTrackerSettings? settings = null)
        {
            IntPtr made;
            ProximityPartTrackerSettings chosen = settings ?? ProximityPartTrackerSettings.Default;
            Connections = new ProximityConnection[connections];
            handle.Scene = scene.Handle;
            fixed (int* rows = parts)
                Native.Check(Native.proximity_create_part_tracker(scene.Handle, rows, (UIntPtr)parts.Length,
                    (UIntPtr)connections, &chosen, &made, out NativeError error), ref error);
            handle.Take(made);
        }

        public ProximityPartTracker(ProximityScene scene, int part, int connections = 1,
            ProximityPartTrackerSettings? settings = null)
            : this(scene, new ReadOnlySpan<int>(&part, 1), connections, settings) { }

        public void Dispose() => handle.Dispose();

        /// <summary>Reset: the next tick is treated as the first.</summary>
        public void Reset() => Native.proximity_reset_part_tracker(handle);

        /// <summary>Move the part, or the first of several, and answer. Without a matrix the parts are where they are in the
        /// scene; velocities that are null follow from the last two poses. Instants are ns of one clock.</summary>
        public ProximityConnection[] Tick(ReadOnlySpan<double> matrix, long poseNs, long nowNs,
            ProximityVector? velocity = null, ProximityVector? angularVelocity = null)
        {
            ProximityVector linear = velocity.GetValueOrDefault(), angular = angularVelocity.GetValueOrDefault();
            Native.Expect(matrix.IsEmpty || matrix.Length == 16);
            fixed (double* pose = matrix) fixed (ProximityConnection* to = Connections)
                Native.Check(Native.proximity_tick_part(handle, pose, poseNs, nowNs, velocity.HasValue ? &linear : null,
                    angularVelocity.HasValue ? &angular : null, to, out NativeError error), ref error);
            return Connections;
        }
    }

    /// <summary>A scene; or a tracker, which keeps its scene open.</summary>
    internal sealed class NativeHandle : SafeHandle
    {
        internal GCHandle Content; // bytes of the scene
        internal NativeHandle Scene; // of the tracker
        internal bool IsOfParts; // the tracker
        internal NativeHandle() : base(IntPtr.Zero, true) { }
        public override bool IsInvalid => handle == IntPtr.Zero;

        internal void Take(IntPtr made)
        {
            bool isKept = false;
            SetHandle(made);
            Scene?.DangerousAddRef(ref isKept);
        }

        protected override bool ReleaseHandle()
        {
            if (IsOfParts)
                Native.proximity_destroy_part_tracker(handle);
            else if (Scene != null)
                Native.proximity_destroy_tracker(handle);
            else
                Native.proximity_close(handle);
            Scene?.DangerousRelease();
            if (Content.IsAllocated)
                Content.Free();
            return true;
        }
    }

    [StructLayout(LayoutKind.Sequential, Size = 512)]
    internal struct NativeError
    {
        internal int Code;
        internal byte Sentence; // its first byte
    }

    internal unsafe struct NativePaths
    {
        internal void* Corners;
        internal UIntPtr Count;
        internal void* OfCorners, OfFingers; // bends
    }

    internal static unsafe class Native
    {
        internal static void CheckInterface()
        {
            if (proximity_interface() != 1)
                throw new ProximityError(1, "the library has another interface than Proximity.cs: write both again");
        }

        internal static void Check(int code, ref NativeError error)
        {
            fixed (byte* sentence = &error.Sentence)
                if (code != 0)
                    throw new ProximityError(code, Text(sentence));
        }

        internal static void Expect(bool isSo)
        {
            if (!isSo)
                throw new ProximityError(1, "an array has the wrong length, expected a row for each that is asked");
        }

        internal static byte[] Utf8(string text) => Encoding.UTF8.GetBytes(text + "\0");

        internal static string Text(byte* text)
        {
            int size = 0;
            while (text != null && text[size] != 0)
                size++;
            return size == 0 ? "" : Encoding.UTF8.GetString(text, size);
        }

        [DllImport("proximity")] internal static extern int proximity_interface();
        [DllImport("proximity")] internal static extern int proximity_open(byte* path, IntPtr* scene,
            out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_open_bytes(void* bytes, UIntPtr size,
            IntPtr* scene, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_new_scene(IntPtr* scene, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_from_mesh(byte* name, void* vertices,
            UIntPtr vertexCount, void* faces, UIntPtr faceCount, IntPtr* scene, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_add_scene(NativeHandle scene, NativeHandle added,
            double* matrix, int* first, out NativeError error);
        [DllImport("proximity")] internal static extern byte* proximity_sign_reason(NativeHandle scene, int part);
        [DllImport("proximity")] internal static extern int proximity_remove(NativeHandle scene, int part,
            out NativeError error);
        [DllImport("proximity")] internal static extern void proximity_close(IntPtr scene);
        [DllImport("proximity")] internal static extern int proximity_part_count(NativeHandle scene);
        [DllImport("proximity")] internal static extern byte* proximity_part_name(NativeHandle scene, int part);
        [DllImport("proximity")] internal static extern int proximity_find_part(NativeHandle scene, byte* name);
        [DllImport("proximity")] internal static extern int proximity_pose(NativeHandle scene, int part,
            void* matrix, out NativeError error);
        [DllImport("proximity")] internal static extern void proximity_bounds(NativeHandle scene, void* lower,
            void* upper);
        [DllImport("proximity")] internal static extern int proximity_move(NativeHandle scene, void* parts,
            UIntPtr n, void* poses, void* v, void* w, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_post(NativeHandle scene, int part,
            void* pose, long poseNs, void* v, void* w, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_take(NativeHandle scene, long instantNs,
            out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_hide(NativeHandle scene, int part,
            int isHidden, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_set_surface(NativeHandle scene, int part,
            double stiffness, double damping, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_clearance(NativeHandle s, int first,
            int second, double limit, double tolerance, UIntPtr budget, out ProximityClearance to, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_closest_without(NativeHandle s, void* points,
            UIntPtr n, double limit, void* parts, UIntPtr k, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_signed_distance_without(NativeHandle s, void* points,
            UIntPtr n, void* parts, UIntPtr k, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_distance_without(NativeHandle s, void* points,
            UIntPtr n, void* parts, UIntPtr k, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_contains_without(NativeHandle s, void* points,
            UIntPtr n, void* parts, UIntPtr k, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_cast_without(NativeHandle s, void* a, void* b,
            UIntPtr n, double limit, void* parts, UIntPtr k, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_closest_to_segments_without(NativeHandle s, void* a,
            void* b, UIntPtr n, double limit, void* parts, UIntPtr k, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern ProximityTrackerSettings proximity_default_settings();
        [DllImport("proximity")] internal static extern int proximity_create_tracker(NativeHandle s, UIntPtr fingers,
            void* settings, IntPtr* made, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_set_radius(NativeHandle tracker,
            UIntPtr finger, double radius, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_ignore(NativeHandle tracker, UIntPtr finger,
            int part, int isIgnored, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_tick(NativeHandle t, void* at, void* poseNs,
            long ns, void* v, void* paths, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern void proximity_reset_tracker(NativeHandle tracker);
        [DllImport("proximity")] internal static extern void proximity_destroy_tracker(IntPtr tracker);
        [DllImport("proximity")] internal static extern int proximity_closest_pairs(NativeHandle s, int part, double limit,
            UIntPtr capacity, void* parts, void* answers, UIntPtr* count, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_penetration(NativeHandle s, int first, int second,
            void* direction, double tolerance, out ProximityPenetration answer, out NativeError error);
        [DllImport("proximity")] internal static extern ProximityPartTrackerSettings proximity_default_part_settings();
        [DllImport("proximity")] internal static extern int proximity_create_part_tracker(NativeHandle s, void* parts,
            UIntPtr group, UIntPtr connections, void* settings, IntPtr* made, out NativeError error);
        [DllImport("proximity")] internal static extern int proximity_tick_part(NativeHandle t, void* matrix, long poseNs,
            long nowNs, void* v, void* w, void* to, out NativeError error);
        [DllImport("proximity")] internal static extern void proximity_reset_part_tracker(NativeHandle tracker);
        [DllImport("proximity")] internal static extern void proximity_destroy_part_tracker(IntPtr tracker);
    }
}
