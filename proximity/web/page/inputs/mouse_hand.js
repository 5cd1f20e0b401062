// A hand that follows the mouse: the wheel is depth, keys bend its fingers.

import * as THREE from "three";
import { isTyped } from "../panel.js";
import { fingersOf } from "./hand.js";

const EVERY_MS = 11;
const LENGTH = 0.1; // m: of the parts' size, for a hand of true size
const SMALLEST = 0.5;
const OPEN = 0.12; // of a hand at rest
const SPEED = 2.6; // of bending, a second
const V = (x, y, z) => new THREE.Vector3(x, y, z);
/** Right hand, palm down, fingers towards -z: knuckle, bones, m. */
const SHAPE = {
  "index-finger": [V(-0.025, 0, -0.085), [0.043, 0.025, 0.022], 0.09],
  "middle-finger": [V(-0.003, 0.002, -0.088), [0.047, 0.029, 0.023], 0.0],
  "ring-finger": [V(0.018, 0, -0.083), [0.043, 0.027, 0.023], -0.08],
  "pinky-finger": [V(0.036, -0.004, -0.073), [0.034, 0.02, 0.021], -0.17],
};
const BENDS = [1.4, 1.75, 1.15];
const THUMB = { base: V(-0.02, -0.008, -0.022), bones: [0.045, 0.034, 0.028], bends: [0.9, 1.2] };
const RADII = { tip: 0.007, distal: 0.008, intermediate: 0.009, proximal: 0.01, metacarpal: 0.011 };

export class MouseHand {
  constructor(stage, send) {
    this.stage = stage;
    this.send = send;
    this.joints = null;
    this.pointer = null;
    this.depth = 0; // m, away from the eye, of the plane through the middle of the view
    this.bends = new Array(5).fill(OPEN);
    this.held = new Set();
    this.isOn = false;
  }

  hint = "Wheel: away or towards you. Hold F, or 1 to 5, to bend fingers.";

  start() {
    if (this.isOn) return;
    this.isOn = true;
    this.listening = new AbortController();
    const { signal } = this.listening;
    const canvas = this.stage.canvas;
    canvas.addEventListener("pointermove", (event) => this.point(event), { signal });
    document.addEventListener("pointerleave", () => (this.pointer = null), { signal });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { signal, passive: false, capture: true });
    addEventListener("keydown", (event) => this.key(event, true), { signal });
    addEventListener("keyup", (event) => this.key(event, false), { signal });
    addEventListener("blur", () => this.held.clear(), { signal });
    this.lastMs = performance.now();
    this.timer = setInterval(() => this.step(), EVERY_MS);
  }

  stop() {
    if (!this.isOn) return;
    this.isOn = false;
    this.listening.abort();
    clearInterval(this.timer);
    this.joints = null;
    this.send([]);
  }

  point(event) {
    this.pointer = [(2 * event.clientX) / innerWidth - 1, 1 - (2 * event.clientY) / innerHeight];
  }

  wheel(event) {
    if (event.ctrlKey) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    this.depth -= Math.sign(event.deltaY) * 0.025 * this.stage.radius;
  }

  key(event, isDown) {
    if (isDown && isTyped(event)) return;
    const fingers = event.code === "KeyF" ? [0, 1, 2, 3, 4] : /^(Digit|Numpad)[1-5]$/.test(event.code) ? [Number(event.code.at(-1)) - 1] : [];
    for (const finger of fingers) isDown ? this.held.add(finger) : this.held.delete(finger);
  }

  step() {
    const now = performance.now();
    const elapsed = Math.min((now - this.lastMs) / 1e3, 0.1);
    this.lastMs = now;
    this.bends = this.bends.map((bend, k) => {
      const goal = this.held.has(k) ? 1 : OPEN;
      return bend + Math.sign(goal - bend) * Math.min(Math.abs(goal - bend), SPEED * elapsed);
    });
    this.joints = this.pointer === null ? null : this.placed();
    this.send(this.joints === null ? [] : fingersOf(this.joints, true, this.hasPaths), now);
  }

  /** Joints in the scene's frame, the open index fingertip under the pointer. */
  placed() {
    const { camera, controls, root } = this.stage;
    const forward = camera.getWorldDirection(V(0, 0, 0));
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(
      forward.clone().negate(),
      controls.target.clone().addScaledVector(forward, this.depth),
    );
    const caster = new THREE.Raycaster();
    caster.setFromCamera(new THREE.Vector2(...this.pointer), camera);
    const tip = caster.ray.intersectPlane(plane, V(0, 0, 0));
    if (tip === null) return this.joints;
    // It comes from the lower right, with its back to the eye, and is no larger than the parts.
    const size = Math.min(Math.max(this.stage.radius / LENGTH, SMALLEST), 1);
    const away = V(-0.4, 0.85, -0.35).applyQuaternion(camera.quaternion).normalize();
    const across = new THREE.Vector3().crossVectors(away, forward).negate().normalize();
    const up = new THREE.Vector3().crossVectors(across, away);
    const turn = new THREE.Matrix4().makeBasis(across, up, away.clone().negate()).scale(V(size, size, size));
    const open = handJoints(this.bends.map(() => OPEN)).get("index-finger-tip").position.applyMatrix4(turn);
    const world = turn.setPosition(tip.sub(open));
    root.updateMatrixWorld(true);
    const sceneFromHand = root.matrixWorld.clone().invert().multiply(world);
    const rotation = new THREE.Quaternion().setFromRotationMatrix(new THREE.Matrix4().extractRotation(sceneFromHand));
    const joints = handJoints(this.bends);
    for (const joint of joints.values()) {
      joint.position.applyMatrix4(sceneFromHand);
      joint.radius *= size;
      joint.quaternion.premultiply(rotation);
    }
    return joints;
  }
}

/** The joints of a right hand about its wrist, with each finger bent from 0 to 1. */
export function handJoints(bends) {
  const joints = new Map();
  const put = (name, position, quaternion) => {
    const end = name.split("-").at(-1);
    joints.set(name, { position: position.clone(), quaternion: quaternion.clone(), radius: RADII[end] ?? 0.016 });
  };
  put("wrist", V(0, 0, 0.01), new THREE.Quaternion());
  putThumb(put, bends[0]);
  Object.entries(SHAPE).forEach(([name, [knuckle, bones, spread]], k) => {
    const base = new THREE.Quaternion().setFromAxisAngle(V(0, 1, 0), spread);
    put(`${name}-metacarpal`, V(0.6 * knuckle.x, 0, 0.25 * knuckle.z), base);
    const place = knuckle.clone();
    const turn = base.clone();
    ["proximal", "intermediate", "distal"].forEach((bone, i) => {
      turn.multiply(new THREE.Quaternion().setFromAxisAngle(V(-1, 0, 0), BENDS[i] * bends[k + 1]));
      put(`${name}-phalanx-${bone}`, place, turn);
      place.add(V(0, 0, -bones[i]).applyQuaternion(turn));
    });
    put(`${name}-tip`, place, turn);
  });
  return joints;
}

function putThumb(put, bend) {
  const along = V(-0.62, -0.2, -0.76).normalize();
  const across = new THREE.Vector3().crossVectors(along, V(0.35, 0.9, 0.1)).normalize();
  const up = new THREE.Vector3().crossVectors(across, along);
  const turn = new THREE.Quaternion().setFromRotationMatrix(new THREE.Matrix4().makeBasis(across, up, along.clone().negate()));
  const place = THUMB.base.clone();
  put("thumb-metacarpal", place, turn);
  ["phalanx-proximal", "phalanx-distal", "tip"].forEach((name, k) => {
    place.add(V(0, 0, -THUMB.bones[k]).applyQuaternion(turn));
    if (k < 2) turn.multiply(new THREE.Quaternion().setFromAxisAngle(V(-1, 0, 0), THUMB.bends[k] * bend));
    put(`thumb-${name}`, place, turn);
  });
}
