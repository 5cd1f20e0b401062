// ProximityMailbox.cs: frames by shm://NAME, the shared memory of one user on Linux, through the library in C.
//
// Made by `proximity client csharp`; changes here are lost. Needs ProximityMessages.cs, ProximityClient.cs and
// libproximity.so of the same version.
using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Proximity
{
    /// <summary>Reads and validates frames in shared memory, like ProximitySubscriber for datagrams.</summary>
    public sealed unsafe class ProximityMailboxSubscriber : ProximityFrameReader, IDisposable
    {
        private const int Ok = 0, Nobody = 1;
        private const long NameNs = 100000000; // between two checks whether the name leads to another mailbox
        private readonly byte[] name, buffer = new byte[1 << 20];
        private IntPtr box;
        private bool isOpen, isNext;
        private long lookedNs = ProximityClock.Ns;

        /// <summary>Read shm://name, now or once it has a publisher.</summary>
        public ProximityMailboxSubscriber(string name, double staleAfter = 0.08, double maxSpeed = 3,
            double maxAcceleration = 120) : base(true, false, staleAfter, maxSpeed, maxAcceleration)
        {
            this.name = Encoding.ASCII.GetBytes(Uri.EscapeDataString(name) + "\0");
            box = Marshal.AllocHGlobal((IntPtr)proximity_box_size());
            Follow();
            isNext = true; // all messages of the next mailbox are new
        }

        /// <summary>Read arrived messages and update the state; never waits, makes no garbage.</summary>
        public ProximityState Read()
        {
            for (int taken = 0; taken < ProximityLayout.MaxAtOnce && (isOpen || Follow()); taken++)
            {
                long size;
                fixed (byte* to = buffer)
                    size = proximity_box_read(box, to, (ulong)buffer.Length);
                if (size >= 0)
                    Offer(buffer, (int)Math.Min(size, buffer.Length + 1L), ProximityClock.Ns);
                else if (!IsOver() || !Follow())
                    break;
            }
            return At(ProximityClock.Ns);
        }

        /// <summary>Wait for a message, with a time limit in seconds; then like Read.</summary>
        public ProximityState Wait(double seconds)
        {
            long untilNs = ProximityClock.Ns + (long)(1e9 * seconds);
            if (isOpen || Follow())
                proximity_box_wait(box, untilNs);
            else
                System.Threading.Thread.Sleep((int)Math.Ceiling(1e3 * Math.Min(seconds, 0.01)));
            return Read();
        }

        public void Dispose()
        {
            Leave();
            Marshal.FreeHGlobal(box);
            box = IntPtr.Zero;
        }

        private bool IsOver()
        {
            long now = ProximityClock.Ns;
            bool looks = now - lookedNs > NameNs;
            lookedNs = looks ? now : lookedNs;
            return proximity_box_is_over(box, looks ? 1 : 0) != 0;
        }

        private void Leave()
        {
            if (isOpen)
                proximity_box_close(box);
            isOpen = false;
        }

        private bool Follow()
        {
            Leave();
            int outcome;
            fixed (byte* text = name)
                outcome = proximity_box_open(box, text, isNext ? 1 : 0);
            if (outcome != Ok && outcome != Nobody)
                throw new ProximityServiceError(Marshal.PtrToStringAnsi(proximity_box_reason(outcome)));
            isOpen = outcome == Ok;
            return isOpen;
        }

        [DllImport("proximity")] private static extern long proximity_box_size();
        [DllImport("proximity")] private static extern int proximity_box_open(IntPtr box, byte* name, int isNext);
        [DllImport("proximity")] private static extern long proximity_box_read(IntPtr box, byte* to, ulong room);
        [DllImport("proximity")] private static extern int proximity_box_wait(IntPtr box, long untilNs);
        [DllImport("proximity")] private static extern int proximity_box_is_over(IntPtr box, int looksAtName);
        [DllImport("proximity")] private static extern void proximity_box_close(IntPtr box);
        [DllImport("proximity")] private static extern IntPtr proximity_box_reason(int outcome);
    }
}
