// ProximityAxes.cs: from Unity's left-handed axes to the right-handed ones of a scene, and back.
//
// Made by `proximity client csharp`; changes here are lost. The conversion is a mirror. Each function is its own
// inverse; a rotation's axis is reversed as well.
#if UNITY_5_3_OR_NEWER
using System;
using UnityEngine;

namespace Proximity
{
    public enum ProximityMirror
    {
        YAndZ, // are exchanged: parts with z up, the usual CAD axes, stand upright
        X, // changes its sign: parts match the meshes that Unity imports from OBJ and FBX
    }

    public static class ProximityAxes
    {
        /// <summary>A point, a direction or a normal in the scene's axes.</summary>
        public static ProximityVector ToScene(this ProximityMirror mirror, Vector3 v) =>
            mirror == ProximityMirror.X ? new ProximityVector(-v.x, v.y, v.z) : new ProximityVector(v.x, v.z, v.y);

        /// <summary>A point, a direction or a normal of the scene in Unity's axes.</summary>
        public static Vector3 ToUnity(this ProximityMirror mirror, ProximityVector v) =>
            mirror == ProximityMirror.X ? new Vector3((float)-v.X, (float)v.Y, (float)v.Z)
                : new Vector3((float)v.X, (float)v.Z, (float)v.Y);

        /// <summary>Write a pose, in Unity relative to the scene's origin, as a matrix of ProximityScene.Move.</summary>
        public static void ToMatrix(this ProximityMirror mirror, Vector3 position, Quaternion rotation, Span<double> matrix)
        {
            ProximityVector at = mirror.ToScene(position), a = mirror.ToScene(new Vector3(rotation.x, rotation.y, rotation.z));
            double x = -a.X, y = -a.Y, z = -a.Z, w = rotation.w, s = 2 / (x * x + y * y + z * z + w * w);
            Set(matrix.Slice(0), 1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w), at.X);
            Set(matrix.Slice(4), s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w), at.Y);
            Set(matrix.Slice(8), s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y), at.Z);
            Set(matrix.Slice(12), 0, 0, 0, 1);
        }

        private static void Set(Span<double> row, double a, double b, double c, double d)
        {
            row[0] = a;
            row[1] = b;
            row[2] = c;
            row[3] = d;
        }
    }
}
#endif
