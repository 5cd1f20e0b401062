// example.mjs: a fingertip that descends on the sample bracket, and the service's answers. For Node 20 or newer.
//
//   node example.mjs FRAMES_PORT POSES_PORT SECONDS [KEY]
//
// The scene file has `publish = ["udp://127.0.0.1:FRAMES_PORT"]` in [service] and
// `poses = "udp://127.0.0.1:POSES_PORT"` in [input], both with `?key=KEY` if there is one.

import { setTimeout as sleep } from "node:timers/promises";

import { ContactFlag, poseOf } from "./proximity_client.mjs";
import { Publisher, Subscriber, clockNs } from "./proximity_udp.mjs";

function show(now) {
  if (now.header === null) return console.log("no frame yet");
  let line = now.state;
  for (const contact of now.contacts) {
    if ((contact.flags & ContactFlag.TRACKED) === 0) continue; // unknown: remove the hand's force
    // While the frame is valid the distance holds; LATE, only that it is at least the lower bound.
    const how = now.isValid ? "at" : "at least";
    const age = (Number(contact.age_ns) / 1e6).toFixed(1);
    line += `; finger ${contact.finger}: ${how} ${(contact.lower * 1e3).toFixed(3)} mm, pose ${age} ms old`;
  }
  console.log(line);
}

function showCounts({ received, lost, unverified, refused, flawed }) {
  const flaws = Object.entries(flawed).map(([reason, count]) => `, ${reason} ${count}`);
  console.log(`received ${received}, lost ${lost}; not used: unverified ${unverified}, refused ${refused}${flaws.join("")}`);
}

async function main([framesPort, posesPort, seconds, key]) {
  const frames = await Subscriber.open({ port: Number(framesPort), key });
  const poses = await Publisher.open({ port: Number(posesPort), key });
  const began = performance.now();
  const pictures = 90 * Number(seconds); // 90 a second, as a headset has them
  for (let picture = 1; picture <= pictures; picture++) {
    // From 60 mm down at 5 mm a second, until the fingertip of 7 mm is 1 mm inside the foot.
    const tip = [0.05, 0.02, Math.max(0.06 - (0.005 * picture) / 90, 0.01)];
    poses.send("poses", [poseOf(0, tip, clockNs())]);
    await sleep(began + (1e3 * picture) / 90 - performance.now()); // draw here; datagrams arrive in this time
    const now = frames.read(); // never waits
    if (picture % 9 === 0) show(now);
  }
  showCounts(frames.counts);
  await poses.close();
  frames.close();
}

if (process.argv.length < 5) {
  console.error("example: expected FRAMES_PORT POSES_PORT SECONDS [KEY]");
  process.exit(2);
}
main(process.argv.slice(2)).catch((failure) => {
  console.error(`example: ${failure.message}`);
  process.exit(1);
});
