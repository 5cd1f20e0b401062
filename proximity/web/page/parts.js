// The parts: shown from the GLB, listed, hidden, picked, and moved by the service.

import * as THREE from "three";
import { GLTFLoader } from "./vendor/three/addons/loaders/GLTFLoader.js";
import { ENUMS } from "./layout.mjs";

const SEND_MS = 12;
const EDGE = 0.85; // opacity of edges
const FAINT = 0.08; // opacity

export class Parts extends EventTarget {
  constructor(stage, link) {
    super();
    this.stage = stage;
    this.link = link;
    this.list = []; // { name, object, faces, edges, colour, initial, ... } in the order of the scene
    this.waiting = []; // moves whose instant is in the future
    this.picked = null;
    this.wanted = new Map(); // name: matrix to send
    this.clipping = [];
    this.limited = (part, matrix) => matrix; // limits the approach of a part to its target
    this.mayHide = false; // in the service's scene, not only in this picture
    this.loading = Promise.resolve();
    link.addEventListener("moves", (event) => this.waiting.push(...event.detail));
    link.addEventListener("changes", ({ detail }) => this.loading.then(() => this.takeChanges(detail)));
    setInterval(() => this.send(), SEND_MS);
  }

  /** Set the list of parts; their geometry may still be loading, and changes until then are applied later. */
  load(geometry) {
    this.loading = this.loadNow(geometry);
    return this.loading;
  }

  async loadNow(geometry) {
    const gltf = await new GLTFLoader().parseAsync(await geometry, "");
    this.about = gltf.scene.userData;
    for (const object of gltf.scene.children) this.list[object.userData.part] = this.taken(object);
    this.isLoaded = true;
    this.stage.root.add(gltf.scene);
    this.setClipping(this.clipping);
    this.stage.setBounds(this.bounds());
    this.changed();
  }

  /** Reset parts to their initial poses: a service reports its moves and hidden parts again. */
  restore() {
    this.waiting = [];
    for (const { object, about, initial } of this.list) {
      object.matrix.copy(initial);
      object.matrixWorldNeedsUpdate = true;
      if (this.mayHide) object.visible = !about.is_hidden;
    }
    this.changed();
  }

  taken(object) {
    const part = { name: object.userData.name, object, about: object.userData, meshes: [], edges: [] };
    object.visible = !object.userData.is_hidden;
    object.updateMatrix();
    object.matrixAutoUpdate = false; // its matrix is the pose from the service
    part.initial = object.matrix.clone();
    object.traverse((each) => {
      if (each.isMesh) {
        each.material = each.material.clone();
        each.material.polygonOffset = true; // edges are drawn in front of faces
        each.material.polygonOffsetFactor = 1;
        each.material.polygonOffsetUnits = 1;
        each.userData.partOf = part;
        part.meshes.push(each);
        part.colour = `#${each.material.color.getHexString()}`;
      } else if (each.isLine) {
        each.material = new THREE.LineBasicMaterial({ color: 0x0d1117, transparent: true, opacity: EDGE });
        part.edges.push(each);
      }
    });
    return part;
  }

  /** The smallest box around parts, in the frame of *frame*: the scene's. */
  bounds(parts = this.list, frame = this.stage.root) {
    const box = new THREE.Box3();
    this.stage.root.updateMatrixWorld(true);
    const fromWorld = frame.matrixWorld.clone().invert();
    const corner = new THREE.Vector3();
    for (const { geometry, matrixWorld } of parts.flatMap((part) => part.meshes)) {
      const place = fromWorld.clone().multiply(matrixWorld), { position } = geometry.attributes;
      for (let k = 0; k < position.count; k++) box.expandByPoint(corner.fromBufferAttribute(position, k).applyMatrix4(place));
    }
    return box;
  }

  /** Move parts to the poses of frames: a move counts from its instant, ms of the service's clock. */
  follow(frameMs) {
    if (!this.waiting.length || !this.isLoaded) return;
    const later = [];
    for (const move of this.waiting) {
      if (Number(move.pose_ns) / 1e6 <= frameMs) this.place(move);
      else later.push(move);
    }
    if (later.length < this.waiting.length) this.changed();
    this.waiting = later;
  }

  takeChanges(changes) {
    for (const { name, action } of changes) {
      const part = this.named(name);
      if (part && action <= ENUMS.PartAction.SHOW) part.object.visible = action === ENUMS.PartAction.SHOW;
    }
    this.changed();
  }

  named(name) {
    return this.list.find((each) => each.name === name);
  }

  place({ name, rotation, translation }) {
    const part = this.named(name);
    if (!part) return;
    const [a, b, c, d, e, f, g, h, i] = rotation;
    const [x, y, z] = translation;
    part.object.matrix.set(a, b, c, x, d, e, f, y, g, h, i, z, 0, 0, 0, 1);
    part.object.matrixWorldNeedsUpdate = true;
  }

  /** Request a pose of a part; it moves when the service has moved it. */
  ask(part, matrix) {
    this.wanted.set(part.name, this.limited(part, matrix.clone()));
  }

  send() {
    if (!this.wanted.size) return;
    const moves = [...this.wanted].map(([name, { elements: m }]) => ({
      name,
      rotation: [m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]],
      translation: [m[12], m[13], m[14]],
    }));
    this.wanted.clear();
    this.link.sendMoves(moves);
  }

  reset() {
    for (const part of this.list) {
      this.setVisible(part, !part.about.is_hidden);
      if (!part.object.matrix.equals(part.initial)) this.wanted.set(part.name, part.initial.clone());
    }
    this.pick(null);
    this.changed();
  }

  pick(part) {
    this.picked = part;
    for (const each of this.list) {
      for (const mesh of each.meshes) mesh.material.emissive.setHex(each === part ? 0x3a2c10 : 0x000000);
    }
    this.dispatchEvent(new Event("changed"));
  }

  /** Hide or show a part: in the service's scene if permitted, so that distances follow. */
  setVisible(part, isVisible) {
    if (part.object.visible === isVisible) return;
    const { HIDE, SHOW } = ENUMS.PartAction;
    if (this.mayHide) return this.link.sendChanges([{ name: part.name, action: isVisible ? SHOW : HIDE }]);
    part.object.visible = isVisible;
    this.changed();
  }

  setClipping(planes) {
    this.clipping = planes;
    for (const part of this.list) {
      for (const each of [...part.meshes, ...part.edges]) each.material.clippingPlanes = planes;
    }
  }

  /** Make all parts but these faint; null: none. */
  fade(kept) {
    for (const part of this.list) {
      const isFaint = (part.isFaint = kept !== null && !kept.includes(part));
      for (const { material } of part.meshes) {
        Object.assign(material, { transparent: isFaint, opacity: isFaint ? FAINT : 1, depthWrite: !isFaint, needsUpdate: true });
      }
      for (const { material } of part.edges) material.opacity = EDGE * (isFaint ? FAINT : 1);
    }
    this.dispatchEvent(new Event("faded"));
    this.stage.wake();
  }

  /** The nearest part under the pointer: { part, point (world), normal }, or null. */
  under(raycaster) {
    const meshes = this.list.filter((part) => part.object.visible).flatMap((part) => part.meshes);
    const kept = (hit) => this.clipping.every((plane) => plane.distanceToPoint(hit.point) >= 0);
    const hit = raycaster.intersectObjects(meshes, false).find(kept);
    return hit ? { part: hit.object.userData.partOf, point: hit.point } : null;
  }

  /** Parts were moved, hidden or shown. */
  changed() {
    this.stage.wake();
    this.dispatchEvent(new Event("placed"));
    this.dispatchEvent(new Event("changed"));
  }
}
