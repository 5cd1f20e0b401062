// ProximityHand.cs: five fingertips of a Unity hand, measured by a proximity service. Put it on any object, give it the
// transforms of the tips, thumb first, and an object at the scene's origin.
//
// The scene file has `publish = ["udp://127.0.0.1:9100"]` in [service], `poses = "udp://127.0.0.1:9101"` in [input]
// and five fingers. Mirror: see ProximityAxes.cs.
#if UNITY_5_3_OR_NEWER
using Proximity;
using UnityEngine;

public sealed class ProximityHand : MonoBehaviour
{
    public Transform origin;
    public Transform[] tips = new Transform[5];
    public ProximityMirror mirror = ProximityMirror.YAndZ;
    public int framesPort = 9100, posesPort = 9101;
    public string keyFile = "";
    [HideInInspector] public float[] metres = new float[5]; // to the surface; NaN: unknown
    [HideInInspector] public bool[] isBound = new bool[5]; // a lower bound, not the exact distance

    private readonly ProximityPose[] poses = new ProximityPose[5];
    private ProximitySubscriber subscriber;
    private ProximityPublisher publisher;

    private void OnEnable()
    {
        string key = keyFile == "" ? null : keyFile;
        subscriber = new ProximitySubscriber(framesPort, keyFile: key);
        publisher = new ProximityPublisher(posesPort, keyFile: key);
    }

    private void Update()
    {
        for (int finger = 0; finger < tips.Length; finger++)
        {
            ProximityVector tip = mirror.ToScene(origin.InverseTransformPoint(tips[finger].position));
            poses[finger] = ProximityPublisher.PoseOf((uint)finger, tip.X, tip.Y, tip.Z);
        }
        publisher.Send(poses, tips.Length);

        subscriber.Read(); // never waits, makes no garbage
        for (int finger = 0; finger < metres.Length; finger++)
            metres[finger] = float.NaN;
        ProximityContact[] contacts = subscriber.Contacts;
        for (int i = 0; i < contacts.Length; i++)
        {
            if ((contacts[i].Flags & ProximityContactFlag.Tracked) == 0 || contacts[i].Finger >= metres.Length)
                continue; // STALE and STOPPING: no finger is tracked
            metres[contacts[i].Finger] = (float)contacts[i].Lower;
            isBound[contacts[i].Finger] = !subscriber.IsValid || contacts[i].Lower < contacts[i].Upper;
        }
    }

    private void OnDisable()
    {
        subscriber?.Dispose();
        publisher?.Dispose();
    }
}
#endif
