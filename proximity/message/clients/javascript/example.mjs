// example.mjs: a fingertip that comes down on the scene, and what the service says of it. For Node 20 or newer.
//
//   node example.mjs FRAMES_PORT POSES_PORT SECONDS [KEY]
//
// The scene file has `publish = ["udp://127.0.0.1:FRAMES_PORT"]` in [service] and
// `poses = "udp://127.0.0.1:POSES_PORT"` in [input], both with `?key=KEY` where there is one.

import { setTimeout as sleep } from "node:timers/promises";

import { ContactFlag, poseOf } from "./decaff.mjs";
import { Publisher, Subscriber, clockNs } from "./decaff_udp.mjs";

function show(now) {
  let line = `${now.state} age ${(Number(now.ageNs) / 1e6).toFixed(1)} ms`;
  for (const contact of now.contacts) {
    if ((contact.flags & ContactFlag.TRACKED) === 0) continue; // nothing is known: take the hand's force away
    // While the frame is valid the distance holds; LATE, only that it is at least the lower bound.
    const how = now.isValid ? "at" : "at least";
    line += `; finger ${contact.finger}: ${how} ${(contact.lower * 1e3).toFixed(3)} mm`;
  }
  console.log(line);
}

async function main([framesPort, posesPort, seconds, key]) {
  const frames = await Subscriber.open({ port: Number(framesPort), key });
  const poses = await Publisher.open({ port: Number(posesPort), key });
  const began = performance.now();
  for (let gone = 0; gone < Number(seconds); gone = (performance.now() - began) / 1e3) {
    // From 60 mm above the origin's corner down to 40 mm, at 5 mm a second.
    const tip = [0.03, 0.01, Math.max(0.06 - 0.005 * gone, 0.04)];
    poses.send("poses", [poseOf(0, tip, clockNs())]);
    await sleep(10); // datagrams are taken meanwhile
    show(frames.read());
  }
  console.log(`received ${frames.counts.received}, lost ${frames.counts.lost}`);
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
