// proximity_udp.mjs: frames from a proximity service, and poses and moves to it, over UDP, for Node.
//
// Made by `proximity client js`; edits are lost. A browser has no datagrams: there, pass the messages of a
// WebSocket to the FrameReader of proximity_client.mjs.

import dgram from "node:dgram";
import fs from "node:fs";
import { timingSafeEqual } from "node:crypto";

import { FrameReader, encode } from "./proximity_client.mjs";

const TAG_BYTES = 16;
const MAX_BYTES = 65507; // of a datagram over IPv4
const isLoopback = (host) => /^127\.\d+\.\d+\.\d+$/.test(host);
const isAddress = (host) => /^\d{1,3}(\.\d{1,3}){3}$/.test(host);

/** The monotonic clock, ns, BigInt; on Linux that of a service on this machine. */
export const clockNs = () => process.hrtime.bigint();
const calendarNs = () => BigInt(Date.now()) * 1_000_000n;

/** Receives and validates frames: `await Subscriber.open({ port: 9100 })`, then `read()`, which never waits. */
export class Subscriber {
  #socket;
  #frames;
  #key;
  #hosts;

  /** Listen at host:port to *from*, which is needed unless host is on loopback; *key*: file of the key. */
  static async open({ host = "127.0.0.1", port, from, key, ...ageing }) {
    for (const end of [host, from ?? host]) checkEnd(end, port);
    if (from === undefined && !isLoopback(host)) {
      throw new Error(`${host} can be reached by others, expected \`from\`, the one to listen to`);
    }
    const made = new Subscriber();
    made.#key = key === undefined ? null : readKey(key);
    made.#hosts = from === undefined ? [host, "127.0.0.1"] : [from];
    const sharesClock = process.platform === "linux" && isLoopback(from ?? host);
    made.#frames = new FrameReader({ sharesClock, isKeyed: made.#key !== null, ...ageing });
    made.#socket = await bound(port, host);
    made.#socket.on("message", (bytes, sender) => made.#take(bytes, sender.address));
    return made;
  }

  #take(datagram, sender) {
    const { counts } = this.#frames;
    if (!this.#hosts.includes(sender)) return void counts.refused++;
    if (this.#key === null) return void this.#frames.offer(datagram, clockNs());
    const end = datagram.length - TAG_BYTES;
    if (end < 0 || !timingSafeEqual(tagOf(this.#key, datagram.subarray(0, end)), datagram.subarray(end))) {
      return void counts.unverified++;
    }
    this.#frames.offer(datagram.subarray(0, end), clockNs());
  }

  /** The present state; never waits. Datagrams arrive while the program awaits other events. */
  read() {
    return this.#frames.at(clockNs());
  }

  /** The name of a part of the newest frame; "" until it is known. */
  partName(part) {
    return this.#frames.partName(part);
  }

  get counts() {
    return this.#frames.counts;
  }

  close() {
    this.#socket.close();
  }
}

/** Sends poses and moves: `await Publisher.open({ port: 9101 })`, then `send("poses", [poseOf(...)])`. */
export class Publisher {
  #socket;
  #key;
  #session = 0n;
  #sequences = new Map();
  #awake;

  /** Send to host:port; *bind*: local address, needed unless host is on loopback; *key*: file of the key. */
  static async open({ host = "127.0.0.1", port, bind, key }) {
    for (const end of [host, bind ?? host]) checkEnd(end, port);
    if (bind === undefined && !isLoopback(host)) {
      throw new Error(`${host} is not on this machine, expected \`bind\`, the address to send from`);
    }
    const made = new Publisher();
    made.#key = key === undefined ? null : readKey(key);
    made.#begin();
    made.#socket = await bound(0, bind ?? "127.0.0.1");
    made.#socket.on("error", () => {}); // a missing listener is not an error
    await new Promise((done) => made.#socket.connect(port, host, done));
    return made;
  }

  #begin() {
    const now = calendarNs();
    this.#session = now > this.#session ? now : this.#session + 1n;
    this.#sequences.clear();
    this.#awake = now - clockNs();
  }

  /** Send a message of a kind such as "poses", "moves", "changes" or "additions", with its records. */
  send(kind, records) {
    const awake = calendarNs() - clockNs();
    if (awake - this.#awake > 1_000_000_000n) this.#begin(); // the machine was suspended, its monotonic clock stopped
    this.#awake = awake;
    const sequence = this.#sequences.get(kind) ?? 0n;
    const message = encode(kind, { send_ns: clockNs(), session: this.#session, sequence }, records);
    const most = MAX_BYTES - (this.#key === null ? 0 : TAG_BYTES);
    if (message.length > most) {
      throw new RangeError(`a message of ${message.length} bytes does not fit into a datagram (expected at most ${most} bytes)`);
    }
    this.#sequences.set(kind, sequence + 1n);
    this.#socket.send(this.#key === null ? message : Buffer.concat([message, tagOf(this.#key, message)]));
  }

  /** Close it after all messages are sent. */
  close() {
    return new Promise((done) => setImmediate(() => this.#socket.close(done)));
  }
}

function checkEnd(host, port) {
  if (!isAddress(host)) throw new Error(`"${host}" is not an IPv4 address, expected one such as 127.0.0.1`);
  if (!Number.isInteger(port) || port < 1 || port > 65535) throw new Error(`port is ${port}, expected one from 1 to 65535`);
}

function bound(port, host) {
  const socket = dgram.createSocket({ type: "udp4", recvBufferSize: 1 << 19 });
  return new Promise((done, refuse) => {
    socket.once("error", (failure) => refuse(new Error(`cannot use ${host}, port ${port} (${failure.code})`)));
    socket.bind({ port, address: host, exclusive: true }, () => {
      socket.removeAllListeners("error");
      done(socket);
    });
  });
}

/** Read a key written by `proximity client key`. */
export function readKey(path) {
  let file;
  try {
    file = fs.openSync(path, fs.constants.O_RDONLY | (fs.constants.O_NONBLOCK ?? 0));
  } catch (failure) {
    throw new Error(`the key ${path} cannot be read (${failure.code}; \`proximity client key --out FILE\` makes one)`);
  }
  try {
    const status = fs.fstatSync(file);
    if (!status.isFile()) throw new Error(`the key ${path} is not a regular file`);
    if (process.platform !== "win32" && status.mode & 0o077) {
      throw new Error(`the key ${path} may be used by others (expected permissions 0600)`);
    }
    const digits = fs.readFileSync(file, "latin1").replace(/[\r\n]+$/, "");
    if (!/^[0-9a-fA-F]{64}$/.test(digits)) throw new Error(`the key ${path} is not a key (expected 64 hexadecimal digits)`);
    return Buffer.from(digits, "hex");
  } finally {
    fs.closeSync(file);
  }
}

// BLAKE2s (RFC 7693) with a key of 32 bytes and a digest of 16: missing in Node's crypto.
const START = Uint32Array.of(
  0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
);
const ORDER = [
  "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d",
  "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0",
].map((row) => Array.from(row, (digit) => parseInt(digit, 16)));
const turned = (x, bits) => (x >>> bits) | (x << (32 - bits));

function hashBlock(h, block, taken, isLast) {
  const m = new Uint32Array(16);
  for (let i = 0; i < 16; i++) m[i] = block[4 * i] | (block[4 * i + 1] << 8) | (block[4 * i + 2] << 16) | (block[4 * i + 3] << 24);
  const v = new Uint32Array(16);
  v.set(h);
  v.set(START, 8);
  v[12] ^= taken;
  if (isLast) v[14] = ~v[14];
  const mix = (a, b, c, d, x, y) => {
    v[a] += v[b] + x;
    v[d] = turned(v[d] ^ v[a], 16);
    v[c] += v[d];
    v[b] = turned(v[b] ^ v[c], 12);
    v[a] += v[b] + y;
    v[d] = turned(v[d] ^ v[a], 8);
    v[c] += v[d];
    v[b] = turned(v[b] ^ v[c], 7);
  };
  for (const s of ORDER) {
    for (let i = 0; i < 4; i++) mix(i, i + 4, i + 8, i + 12, m[s[2 * i]], m[s[2 * i + 1]]);
    for (let i = 0; i < 4; i++) mix(i, 4 + ((i + 1) % 4), 8 + ((i + 2) % 4), 12 + ((i + 3) % 4), m[s[8 + 2 * i]], m[s[9 + 2 * i]]);
  }
  for (let i = 0; i < 8; i++) h[i] ^= v[i] ^ v[i + 8];
}

/** The tag of a message: 16 bytes, which follow it in its datagram. */
export function tagOf(key, message) {
  const h = Uint32Array.from(START);
  h[0] ^= 0x01010000 | (key.length << 8) | TAG_BYTES;
  const block = new Uint8Array(64);
  block.set(key);
  hashBlock(h, block, 64, message.length === 0);
  for (let at = 0; at < message.length; at += 64) {
    const part = message.subarray(at, at + 64);
    block.fill(0);
    block.set(part);
    hashBlock(h, block, 64 + at + part.length, at + 64 >= message.length);
  }
  return Buffer.from(new Uint8Array(h.buffer, 0, TAG_BYTES));
}
