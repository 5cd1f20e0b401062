// Reads frames from shared memory and prints sequence and first finger's distance of each new valid one.
using System;
using System.Globalization;
using Proximity;

public static class Mailbox
{
    public static void Main(string[] words)
    {
        using (var subscriber = new ProximityMailboxSubscriber(words[0]))
        {
            Console.WriteLine("open");
            for (int left = int.Parse(words[1]); left > 0;)
            {
                subscriber.Wait(0.1);
                if (!subscriber.IsNew || !subscriber.IsValid)
                    continue;
                string distance = subscriber.Contacts[0].SignedDistance.ToString("R", CultureInfo.InvariantCulture);
                Console.WriteLine(subscriber.Header.Sequence + " " + distance);
                left--;
            }
            Console.WriteLine(subscriber.Counts.Sessions);
        }
    }
}
