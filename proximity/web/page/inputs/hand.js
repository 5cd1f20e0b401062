// A hand by its 25 joints, as in WebXR: fingertips, their bends, and the paths of bending.

import * as THREE from "three";
import { PATH_CORNERS } from "../layout.mjs";

const FINGERS = ["index-finger", "middle-finger", "ring-finger", "pinky-finger"];
export const NAMES = ["thumb", "index", "middle", "ring", "little"];
const CHAINS = [
  ["thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip"],
  ...FINGERS.map((name) =>
    ["metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"].map((end) => `${name}-${end}`),
  ),
];
export const JOINTS = ["wrist", ...CHAINS.flat()];
/** rad: bend of a joint from the flat hand to the fist, from the knuckle. */
const FIST = { 2: [0.9, 1.2], 3: [1.4, 1.75, 1.15] };

/** The name of a service's finger: five of the left hand, then five of the right. */
export function fingerName(finger, count) {
  if (count <= 5) return NAMES[finger] ?? `${finger}`;
  return `${finger < 5 ? "left" : "right"} ${NAMES[finger % 5] ?? finger}`;
}

/**
 * Fingertips of one hand: { finger, position }, in the frame of the joints, with { bend, corners } if paths are
 * requested. *joints* maps names to { position: Vector3, quaternion: Quaternion }; a finger without all of them is left
 * out.
 */
export function fingersOf(joints, isRight, hasPaths) {
  const found = [];
  CHAINS.forEach((chain, k) => {
    const points = chain.map((name) => joints.get(name));
    if (points.some((joint) => joint === undefined)) return;
    const finger = k + (isRight ? 5 : 0), position = points.at(-1).position.toArray();
    found.push({ finger, position, ...(hasPaths ? pathOf(points) : {}) });
  });
  return found;
}

/**
 * The path of a fingertip from the flat hand (0) to the fist (1) through its present position. Bones keep their
 * lengths; each joint turns about the knuckle's axis, in its share of the whole.
 */
function pathOf(joints) {
  const bones = joints.slice(1).map((joint, k) => joint.position.clone().sub(joints[k].position));
  const moving = bones.slice(1);
  // x of a joint is across the finger; bending turns the tip, which is towards -z, to the palm, -y.
  const axis = new THREE.Vector3(-1, 0, 0).applyQuaternion(joints[1].quaternion);
  const most = FIST[moving.length];
  const now = moving.map((bone, k) => Math.min(Math.max(angle(bones[k], bone, axis), 0), most[k]));
  const total = most.reduce((sum, each) => sum + each, 0);
  const bend = now.reduce((sum, each) => sum + each, 0) / total;
  const corners = new Array(3 * PATH_CORNERS);
  const bone = new THREE.Vector3();
  for (let corner = 0; corner < PATH_CORNERS; corner++) {
    const at = corner / (PATH_CORNERS - 1);
    const tip = joints[1].position.clone();
    let turned = 0;
    moving.forEach((each, k) => {
      const wanted = at <= bend ? (now[k] * at) / (bend || 1) : now[k] + ((most[k] - now[k]) * (at - bend)) / (1 - bend || 1);
      turned += wanted - now[k];
      tip.add(bone.copy(each).applyAxisAngle(axis, turned));
    });
    tip.toArray(corners, 3 * corner);
  }
  return { bend, corners };
}

function angle(from, to, axis) {
  const across = new THREE.Vector3().crossVectors(from, to);
  return Math.atan2(across.dot(axis), from.dot(to));
}

/** Of the radii of joints: slim, so that the part behind is visible. */
const BALL = 0.6;
const BONE = 0.42;

/** A drawn hand: a ball at every joint and a bone between neighbours. */
export class HandShape {
  constructor(parent) {
    this.material = new THREE.MeshStandardMaterial({ roughness: 0.7, transparent: true });
    this.balls = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 16, 10), this.material, JOINTS.length);
    this.bones = new THREE.InstancedMesh(new THREE.CylinderGeometry(1, 1, 1, 12, 1, true).rotateX(Math.PI / 2), this.material, 32);
    // Depth first, then colour: so that transparent parts do not overlap.
    const before = new THREE.MeshBasicMaterial({ colorWrite: false });
    this.meshes = [this.balls, this.bones].flatMap((mesh) => {
      const place = new THREE.InstancedMesh(mesh.geometry, before, mesh.instanceMatrix.count);
      place.instanceMatrix = mesh.instanceMatrix;
      place.renderOrder = 5;
      mesh.renderOrder = 6;
      return [place, mesh];
    });
    for (const mesh of this.meshes) {
      mesh.frustumCulled = false;
      mesh.visible = false;
      before.transparent = true;
      parent.add(mesh);
    }
  }

  hide() {
    for (const mesh of this.meshes) mesh.visible = false;
  }

  /** *opacity*: of a hand that is tracked. */
  show(joints, state, opacity) {
    const isGrey = state === "STALE" || state === "STOPPING";
    this.material.color.setHex(isGrey ? 0x73787f : 0xe6d3c0);
    this.material.opacity = isGrey ? 0.4 : state === "LATE" ? 0.5 * opacity : opacity;
    const matrix = new THREE.Matrix4();
    let balls = 0;
    let bones = 0;
    for (const [name, joint] of joints) {
      const size = name.endsWith("tip") ? 0 : BALL * (joint.radius ?? 0.008);
      matrix.makeScale(size, size, size).setPosition(joint.position);
      this.balls.setMatrixAt(balls++, matrix);
    }
    const between = (from, to) => {
      const [a, b] = [joints.get(from), joints.get(to)];
      if (a && b && bones < 32) this.bones.setMatrixAt(bones++, boneMatrix(a, b, matrix));
    };
    for (const chain of CHAINS) {
      between("wrist", chain[0]);
      chain.slice(1).forEach((name, k) => between(chain[k], name));
    }
    CHAINS.slice(2).forEach((chain, k) => between(CHAINS[k + 1][1], chain[1]));
    this.meshes.forEach((mesh, k) => {
      mesh.count = k < 2 ? balls : bones;
      mesh.visible = true;
    });
    this.balls.instanceMatrix.needsUpdate = this.bones.instanceMatrix.needsUpdate = true;
  }
}

function boneMatrix(a, b, matrix) {
  const along = b.position.clone().sub(a.position);
  const size = BONE * Math.min(a.radius ?? 0.008, b.radius ?? 0.008);
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.clone().normalize());
  const middle = a.position.clone().addScaledVector(along, 0.5);
  return matrix.compose(middle, turn, new THREE.Vector3(size, size, along.length()));
}
