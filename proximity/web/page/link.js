// The live connection: receives frames, moves and geometry, sends poses and moves.

import { decode, encode } from "./proximity_client.mjs";
import { Frames, currentState, nanoseconds } from "./frames.js";
import { KINDS } from "./layout.mjs";

const NAMES = new Map(Object.entries(KINDS).map(([name, { magic }]) => [magic, name]));
const CURRENT_MS = 500;
const PING_MS = 700;
const AGAIN_MS = 600;
const RATE_MS = 1000;
const SENTENCES = {
  4403: "The address has no token: open the address that proximity view printed.",
  4408: "The page was too busy to answer in time. Trying again …",
  4429: "The bridge closed the connection: too many pages or messages.",
  4400: "The bridge refused a message of this page.",
};

export class Link extends EventTarget {
  constructor(token) {
    super();
    this.token = token;
    this.isOpen = false;
    this.frames = new Frames();
    this.latencies = []; // ms from sending a pose to the first frame that answers it
    this.pings = []; // [round trip, offset]
    this.offsetMs = NaN; // service's clock less the page's
    this.sent = []; // instants of sent poses, ms of the page
    this.lastMs = -Infinity; // arrival of the last frame
    this.rate = new Rate();
    this.stopped = false;
    setInterval(() => this.ping(), PING_MS);
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.say({ hello: this.token });
      this.pings = [];
    };
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = (event) => this.closed(event);
  }

  closed(event) {
    const wasOpen = this.isOpen;
    this.isOpen = false;
    const sentence = SENTENCES[event.code] ?? "The connection to the bridge is lost. Trying again …";
    this.emit("closed", { sentence, isFinal: event.code === 4403, wasOpen });
    if (event.code !== 4403) setTimeout(() => this.connect(), AGAIN_MS);
  }

  take(data) {
    if (typeof data === "string") return this.takeDocument(JSON.parse(data));
    const kind = NAMES.get(new DataView(data).getUint32(0, true));
    if (kind === "frame") this.takeFrame(data);
    else if (kind === "moves" || kind === "changes") this.emit(kind, decode(data, kind).records);
  }

  takeDocument(said) {
    if (said.clock !== undefined) return this.learnClock(said.clock, Number(BigInt(said.now_ns)) / 1e6);
    if (said.welcome !== undefined) {
      this.isOpen = true;
      this.ping();
      this.emit("welcome", said.welcome);
    } else if (said.notice !== undefined) this.emit("notice", said.notice);
    else if (said.feeds !== undefined) this.emit("feeds", said.feeds);
    else if (said.place !== undefined) this.emit("place", said);
  }

  takeFrame(data) {
    const now = performance.now();
    const header = this.frames.take(data, now);
    this.lastMs = now;
    if (header !== null) {
      this.rate.add(now, Number(header.sequence));
      this.measure(now, Number(header.pose_ns) / 1e6);
    }
    this.send("ok");
    this.emit("frame", header);
  }

  /** The state at an instant, ms. */
  at(nowMs) {
    const reading = this.frames.at(nowMs);
    const isCurrent = !this.frames.isLogged && nowMs - this.lastMs < CURRENT_MS;
    return { ...reading, state: isCurrent ? currentState(reading) : reading.state };
  }

  /** Measure the latency of the first frame that answers a pose. */
  measure(now, poseMs) {
    const taken = poseMs - this.offsetMs;
    const at = this.sent.findIndex((each) => Math.abs(each - taken) < 4);
    if (at < 0) return;
    this.latencies.push(now - this.sent[at]);
    this.sent.splice(0, at + 1);
    if (this.latencies.length > 600) this.latencies.shift();
  }

  ping() {
    if (this.isOpen) this.say({ clock: performance.now() });
  }

  learnClock(sentMs, theirsMs) {
    const now = performance.now();
    this.pings.push([now - sentMs, theirsMs - (now + sentMs) / 2]);
    if (this.pings.length > 20) this.pings.shift();
    this.offsetMs = this.pings.reduce((best, each) => (each[0] < best[0] ? each : best))[1];
  }

  say(what) {
    this.send(JSON.stringify(what));
  }

  send(data) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(data);
  }

  /** Send poses of fingers, taken at *atMs* of this page. */
  sendPoses(fingers, atMs) {
    if (!this.isOpen || !fingers.length || this.socket.bufferedAmount > 200_000) return;
    const pose_ns = nanoseconds(atMs);
    const hasPath = fingers.some((finger) => finger.corners);
    const records = fingers.map(({ finger, ...given }) => {
      const record = { finger, pose_ns }; // a missing field is unknown
      for (const name of ["position", "bend", "corners"]) if (given[name] != null) record[name] = given[name];
      return record;
    });
    const header = { send_ns: nanoseconds(performance.now()) };
    this.send(encode(hasPath ? "path_poses" : "poses", header, records));
    this.sent.push(atMs);
    if (this.sent.length > 50) this.sent.shift();
  }

  /** Request new poses of parts: name, rotation row by row, translation. */
  sendMoves(moves) {
    if (!this.isOpen || !moves.length) return;
    const pose_ns = nanoseconds(performance.now());
    const still = [0, 0, 0];
    const records = moves.map((move) => ({ ...move, pose_ns, velocity: still, angular_velocity: still }));
    this.send(encode("moves", { send_ns: pose_ns }, records));
  }

  /** Request that a part be hidden or shown: name, and an action of PartAction. */
  sendChanges(changes) {
    if (!this.isOpen) return;
    this.send(encode("changes", { send_ns: nanoseconds(performance.now()) }, changes));
  }

  emit(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}

/** Frames a second published by the service, by their numbers: most are not sent to the page. */
export class Rate {
  hz = NaN;

  add(now, sequence) {
    if (!this.begin || sequence < this.begin[1]) this.begin = [now, sequence];
    const [begin, first] = this.begin;
    if (now - begin < RATE_MS) return;
    this.hz = (1000 * (sequence - first)) / (now - begin);
    this.begin = [now, sequence];
  }
}

/** A percentile of numbers; nan of none. */
export function percentile(numbers, share) {
  if (!numbers.length) return NaN;
  const sorted = [...numbers].sort((a, b) => a - b);
  return sorted[Math.min(Math.floor(share * sorted.length), sorted.length - 1)];
}
