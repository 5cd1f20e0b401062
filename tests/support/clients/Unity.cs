// Stubs of the Unity types that components use, and a program that runs one. Arguments: the scene's folder, the mirror,
// and the poses of the query object, of the scene's origin and of the moved part, 7 numbers each.
using System;
using System.Globalization;
using System.Reflection;

namespace UnityEngine
{
    public class HideInInspectorAttribute : Attribute { }

    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 operator +(Vector3 a, Vector3 b) => new Vector3(a.x + b.x, a.y + b.y, a.z + b.z);
        public static Vector3 operator -(Vector3 a, Vector3 b) => new Vector3(a.x - b.x, a.y - b.y, a.z - b.z);
    }

    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static Quaternion Inverse(Quaternion q) => new Quaternion(-q.x, -q.y, -q.z, q.w);
        public static Quaternion operator *(Quaternion a, Quaternion b) => new Quaternion(
            a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            Quaternion turned = q * new Quaternion(v.x, v.y, v.z, 0) * Inverse(q);
            return new Vector3(turned.x, turned.y, turned.z);
        }
    }

    public class Transform
    {
        public string name = "";
        public Vector3 position;
        public Quaternion rotation = new Quaternion(0, 0, 0, 1);
        public Vector3 InverseTransformPoint(Vector3 point) => Quaternion.Inverse(rotation) * (point - position);
        public Vector3 TransformPoint(Vector3 point) => rotation * point + position;
        public Vector3 TransformDirection(Vector3 direction) => rotation * direction;
    }

    public class MonoBehaviour { public readonly Transform transform = new Transform(); }
    public static class Application { public static string streamingAssetsPath; }
    public struct Rect { public Rect(float x, float y, float width, float height) { } }
    public static class Debug { public static void LogWarning(string text) { Console.WriteLine(text); } }
    public static class GUI { public static void Label(Rect place, string text) { Console.WriteLine(text); } }
    public static class Gizmos { public static void DrawLine(Vector3 from, Vector3 to) { } }

    public static class Program
    {
        private static Transform Take(string[] words, int at)
        {
            var n = Array.ConvertAll(words, word => float.Parse(word, CultureInfo.InvariantCulture));
            return new Transform
            {
                position = new Vector3(n[at], n[at + 1], n[at + 2]),
                rotation = new Quaternion(n[at + 3], n[at + 4], n[at + 5], n[at + 6]),
            };
        }

        private static void Send(object component, string message)
        {
            component.GetType().GetMethod(message, BindingFlags.NonPublic | BindingFlags.Instance).Invoke(component, null);
        }

        public static void Main(string[] words)
        {
            CultureInfo.CurrentCulture = CultureInfo.InvariantCulture;
            Application.streamingAssetsPath = words[0];
            var numbers = new string[21];
            Array.Copy(words, 3, numbers, 0, 21);
            var component = new ProximityDistance
            {
                mirror = (Proximity.ProximityMirror)Enum.Parse(typeof(Proximity.ProximityMirror), words[1]),
                origin = Take(numbers, 7),
                movers = new[] { Take(numbers, 14), Take(numbers, 14) },
            };
            component.movers[0].name = "Cube (1)";
            component.movers[1].name = words[2];
            component.transform.position = Take(numbers, 0).position;
            foreach (string message in new[] { "OnEnable", "Update", "Update", "OnGUI", "OnDrawGizmos", "OnDisable", "Update" })
                Send(component, message);
            foreach (Vector3 v in new[] { component.nearest, component.normal })
                Console.WriteLine(v.x.ToString("R") + " " + v.y.ToString("R") + " " + v.z.ToString("R"));
            Console.WriteLine(component.metres.ToString("R") + " " + component.part);
        }
    }
}
