// Command-line driver of the client in JavaScript, see client_programs.py.
import fs from "node:fs";
import { setTimeout as sleep } from "node:timers/promises";

import { FrameReader, PartAction, STATE_NAMES, additionOf, changeOf, encode, moveOf, poseOf } from "./proximity_client.mjs";
import { Publisher, Subscriber, clockNs, readKey, tagOf } from "./proximity_udp.mjs";

const FLAWS = ["", "short", "magic", "version", "size", "checksum", "old", "future", "content"];
const [mode, ...words] = process.argv.slice(2);
const word = (k) => (words[k] === "-" ? undefined : words[k]);

function readEvents(from, to) {
  const events = fs.readFileSync(from);
  const parts = [];
  const put = (size, name, value) => {
    const part = Buffer.alloc(size);
    part[name](value);
    parts.push(part);
  };
  const reader = new FrameReader({ sharesClock: events[0] !== 0, isKeyed: events[1] !== 0 });
  for (let at = 2; at < events.length; ) {
    const kind = events[at];
    const now = events.readBigInt64LE(at + 1);
    at += 9;
    if (kind === 1) {
      const size = events.readUInt32LE(at);
      put(1, "writeUInt8", FLAWS.indexOf(reader.offer(events.subarray(at + 4, at + 4 + size), now)));
      at += 4 + size;
      continue;
    }
    const known = reader.at(now);
    put(1, "writeUInt8", STATE_NAMES.indexOf(known.state));
    put(1, "writeUInt8", Number(known.isNew));
    put(8, "writeBigInt64LE", known.nowNs);
    put(8, "writeBigInt64LE", known.ageNs);
    put(4, "writeUInt32LE", known.contacts.length);
    parts.push(encode("frame", {}, known.contacts).subarray(96));
    for (let finger = 0; finger < known.contacts.length; finger++) {
      const valid = reader.lastValid(finger);
      put(1, "writeUInt8", Number(valid !== null));
      parts.push(valid === null ? Buffer.alloc(328) : encode("frame", {}, [valid]).subarray(96));
    }
  }
  put(8, "writeBigUInt64LE", BigInt(reader.counts.received));
  put(8, "writeBigUInt64LE", reader.counts.lost);
  put(8, "writeBigUInt64LE", BigInt(reader.counts.sessions));
  for (let part = -1; part < 4; part++) parts.push(Buffer.from(`${reader.partName(part)}\n`));
  parts.push(Buffer.from(`${reader.refused} ${reader.refusal}\n`));
  fs.writeFileSync(to, Buffer.concat(parts));
}

async function send() {
  const publisher = await Publisher.open({ host: word(0), port: Number(words[1]), bind: word(2), key: word(3) });
  try {
    const poses = [poseOf(0, [1, 2, 3], clockNs()), poseOf(1, [4, 5, 6], clockNs())];
    if (words.length > 4) publisher.send("moves", [moveOf("x".repeat(65), [7, 8, 9], clockNs())]);
    if (mode === "sender") publisher.send("poses", new Array(4096).fill(poses[0]));
    publisher.send("poses", poses);
    publisher.send("moves", [moveOf("lid ä", [7, 8, 9], clockNs())]);
    publisher.send("changes", [changeOf("lid ä", PartAction.HIDE)]);
    publisher.send("additions", [additionOf("lid ä", "inner/lid.stl", [7, 8, 9])]);
    publisher.send("poses", poses);
  } finally {
    await publisher.close();
  }
}

async function listen() {
  const subscriber = await Subscriber.open({ host: word(0), port: Number(words[1]), from: word(2), key: word(3) });
  console.log("listening");
  let now = subscriber.read();
  for (; now.state !== "STOPPING"; now = subscriber.read()) {
    if (now.isNew && now.isValid) console.log(`${now.contacts[0].finger} ${now.contacts[0].signed_distance.toFixed(6)}`);
    await sleep(1);
  }
  console.log(`received ${subscriber.counts.received} unverified ${subscriber.counts.unverified}`);
  subscriber.close();
}

try {
  if (mode === "read") readEvents(...words);
  else if (mode === "tag") {
    const data = fs.readFileSync(words[1]);
    for (const size of words.slice(2)) console.log(tagOf(readKey(words[0]), data.subarray(0, Number(size))).toString("hex"));
  } else if (mode === "listen") await listen();
  else await send();
} catch (failure) {
  if (failure.constructor === Error || failure instanceof RangeError) console.log(failure.message);
  else throw failure;
  process.exitCode = 1;
}
