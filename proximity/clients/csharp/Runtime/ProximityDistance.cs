// ProximityDistance.cs: distance of this object to the parts of a compiled scene, which may be concave and move.
//
// Put it on any object. `proximity compile` makes the scene's file, for Assets/StreamingAssets. Mirror: see
// ProximityAxes.cs. In a component that answers for fingers at every tick take a ProximityTracker.
#if UNITY_5_3_OR_NEWER
using System;
using System.IO;
using Proximity;
using UnityEngine;

public sealed class ProximityDistance : MonoBehaviour
{
    public string sceneFile = "bracket.prox";
    public Transform origin; // the pose of the scene's origin; without scale
    public Transform[] movers = new Transform[0]; // each moves the part of the same name; others are reported and skipped
    public ProximityMirror mirror = ProximityMirror.YAndZ;

    public float metres; // negative inside
    public Vector3 nearest, normal; // the surface point, and the direction away from it; in the world
    public string part = "";

    private ProximityScene scene;
    private Transform[] moving; // movers that have a part
    private string[] names;
    private int[] moved;
    private double[] matrices;

    private void OnEnable()
    {
        scene = new ProximityScene(Path.Combine(Application.streamingAssetsPath, sceneFile));
        names = new string[scene.PartCount];
        for (int k = 0; k < names.Length; k++)
            names[k] = scene.NameOf(k);
        moving = Array.FindAll(movers, mover => scene.Find(mover.name) >= 0);
        moved = Array.ConvertAll(moving, mover => scene.Find(mover.name));
        foreach (Transform mover in Array.FindAll(movers, mover => !Array.Exists(moving, known => known == mover)))
            Debug.LogWarning(sceneFile + " has no part named \"" + mover.name + "\": it is not moved (expected one of "
                + string.Join(", ", names) + ")");
        matrices = new double[16 * moved.Length];
    }

    private void Update() // makes no garbage
    {
        if (scene == null)
            return; // it could not be opened
        for (int k = 0; k < moved.Length; k++)
            mirror.ToMatrix(origin.InverseTransformPoint(moving[k].position),
                Quaternion.Inverse(origin.rotation) * moving[k].rotation, new Span<double>(matrices, 16 * k, 16));
        if (moved.Length > 0)
            scene.Move(moved, matrices);
        ProximityClosestPoint found = scene.Closest(mirror.ToScene(origin.InverseTransformPoint(transform.position)));
        metres = (float)found.SignedDistance;
        nearest = origin.TransformPoint(mirror.ToUnity(found.Point));
        normal = origin.TransformDirection(mirror.ToUnity(found.Gradient));
        part = found.Part < 0 ? "" : names[found.Part];
    }

    private void OnGUI()
    {
        GUI.Label(new Rect(10, 10, 500, 30), (1e3f * metres).ToString("F2") + " mm to " + part);
    }

    private void OnDrawGizmos()
    {
        Gizmos.DrawLine(transform.position, scene == null ? transform.position : nearest);
    }

    private void OnDisable()
    {
        scene?.Dispose();
        scene = null;
    }
}
#endif
