// Hands of a headset (25 joints each), or its controllers (a fingertip each), by WebXR.

import * as THREE from "three";
import { JOINTS, fingersOf } from "./hand.js";

const PINCH = 0.018; // m between thumb and index fingertip
const OPEN = 0.035;
const REACH = 0.03; // m from a part that can be grasped
const TIP = new THREE.Vector3(0, 0, -0.06); // of a controller, from its grip

/** Whether a headset can be used, as a sentence: empty if it can. */
export async function whyNot() {
  if (!isSecureContext) return "A headset needs https, or the address http://localhost by adb reverse (docs/guide/page.md).";
  if (!navigator.xr) return "This browser has no WebXR: open this address in the headset's own browser (docs/guide/page.md).";
  const isThere = await navigator.xr.isSessionSupported("immersive-vr").catch(() => false);
  return isThere ? "" : "No headset is connected to this browser: connect one, or open this address in the browser of the headset.";
}

export class Headset {
  constructor(stage, parts, send) {
    this.stage = stage;
    this.parts = parts;
    this.send = send;
    this.hands = new Map(); // "left" and "right": joints in the scene's frame
    this.grasps = new Map();
    this.joints = null;
    this.isOn = false;
    this.contacts = [];
  }

  hint = "Hands or controllers of the headset. Pinch near a part to move it.";

  async start() {
    if (this.isOn) return;
    const options = { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking"] };
    this.session = await navigator.xr.requestSession("immersive-vr", options);
    this.isOn = true;
    this.session.addEventListener("end", () => this.ended());
    this.isPlaced = false;
    await this.stage.renderer.xr.setSession(this.session);
    this.taker = (frame) => this.take(frame);
    this.stage.takers.add(this.taker);
  }

  async stop() {
    if (this.isOn) await this.session.end();
  }

  ended() {
    this.isOn = false;
    this.stage.takers.delete(this.taker);
    this.stage.putBack();
    this.stage.resize();
    this.stage.home();
    this.hands.clear();
    this.send([]);
    this.onEnd?.();
  }

  /** Joints and fingertips of one frame; a frame is valid only during its callback. */
  take(frame) {
    const atMs = performance.now();
    const space = this.stage.renderer.xr.getReferenceSpace();
    if (!space || !this.place(frame, space)) return;
    this.stage.root.updateMatrixWorld(true);
    const sceneFromWorld = this.stage.root.matrixWorld.clone().invert();
    const found = [];
    this.hands.clear();
    for (const source of this.session.inputSources) {
      const isRight = source.handedness === "right";
      if (source.hand) {
        const joints = jointsOf(frame, source.hand, space, sceneFromWorld);
        if (!joints.size) continue;
        this.hands.set(source.handedness, joints);
        found.push(...fingersOf(joints, isRight, this.hasPaths));
        this.grasp(source.handedness, joints);
      } else if (source.gripSpace) {
        const pose = frame.getPose(source.gripSpace, space);
        if (!pose) continue;
        const matrix = sceneFromWorld.clone().multiply(new THREE.Matrix4().fromArray(pose.transform.matrix));
        found.push({ finger: isRight ? 6 : 1, position: TIP.clone().applyMatrix4(matrix).toArray() });
        this.hold(source.handedness, matrix, source.gamepad?.buttons[0]?.pressed ?? false, isRight ? 6 : 1);
      }
    }
    this.send(found, atMs);
  }

  /** Place the parts in front of the wearer, once the pose of the headset is known. */
  place(frame, space) {
    if (this.isPlaced) return true;
    const viewer = frame.getViewerPose(space);
    if (!viewer) return false;
    const eyes = new THREE.Matrix4().fromArray(viewer.transform.matrix);
    const towards = new THREE.Vector3(0, 0, -1).transformDirection(eyes);
    this.stage.putBefore(new THREE.Vector3().setFromMatrixPosition(eyes), towards);
    this.isPlaced = true;
    return true;
  }

  grasp(side, joints) {
    const [thumb, index] = [joints.get("thumb-tip"), joints.get("index-finger-tip")];
    if (!thumb || !index) return;
    const apart = thumb.position.distanceTo(index.position);
    const isHeld = this.grasps.has(side) ? apart < OPEN : apart < PINCH;
    const wrist = joints.get("wrist") ?? index;
    const matrix = new THREE.Matrix4().compose(index.position, wrist.quaternion, new THREE.Vector3(1, 1, 1));
    this.hold(side, matrix, isHeld, side === "right" ? 6 : 1);
  }

  /** Move the nearby part along with a hand while it is grasped. */
  hold(side, matrix, isHeld, finger) {
    if (!isHeld) return void this.grasps.delete(side);
    let held = this.grasps.get(side);
    if (!held) {
      const contact = this.contacts.find((each) => each.finger === finger && each.isKnown);
      const part = contact && contact.distance < REACH ? this.parts.list[contact.part] : null;
      if (!part) return;
      held = { part, handFromPart: matrix.clone().invert().multiply(part.object.matrix) };
      this.grasps.set(side, held);
    }
    this.parts.ask(held.part, matrix.clone().multiply(held.handFromPart));
  }
}

function jointsOf(frame, hand, space, sceneFromWorld) {
  const joints = new Map();
  const turn = new THREE.Quaternion().setFromRotationMatrix(sceneFromWorld);
  for (const name of JOINTS) {
    const joint = hand.get(name);
    const pose = joint && frame.getJointPose(joint, space);
    if (!pose) continue;
    const { position: p, orientation: q } = pose.transform;
    joints.set(name, {
      position: new THREE.Vector3(p.x, p.y, p.z).applyMatrix4(sceneFromWorld),
      quaternion: new THREE.Quaternion(q.x, q.y, q.z, q.w).premultiply(turn),
      radius: pose.radius,
    });
  }
  return joints;
}
