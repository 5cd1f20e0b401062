// A plane across x, y or z that clips the parts, and shows the signed distance as colours.

import * as THREE from "three";
import { sliceColour } from "../colours.js";
import { mm } from "../frames.js";
import { byId, makeChoice, showChoice } from "../panel.js";
import { niceStep } from "../stage.js";

const MAX_POINTS = 26_000;
const MARGIN = 0.35; // beyond the parts, of their size
const WAIT_MS = 60;
const ASIDE = 1e-4; // of the parts' size, offset of the clipping plane, which cuts off objects in it
const AXES = [["x", "x"], ["y", "y"], ["z", "z"]];

export class SlicePlane {
  constructor(stage, parts, local) {
    Object.assign(this, { stage, parts, local });
    this.clips = false;
    this.slices = false;
    this.axis = "y";
    this.share = 0.5;
    this.ticket = 0;
    this.texture = null;
    const material = new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, toneMapped: false, transparent: true, opacity: 0.93 });
    this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
    this.mesh.visible = false;
    this.mesh.renderOrder = 2;
    material.polygonOffset = true; // in front of the cut, in the same plane
    material.polygonOffsetFactor = material.polygonOffsetUnits = -2;
    this.cut = new Cut(stage, parts);
    stage.root.add(this.mesh);
    makeChoice(byId("plane-axis"), AXES, this.axis, (axis) => {
      this.axis = axis;
      this.update();
    });
    byId("plane-offset").oninput = (event) => {
      this.share = event.target.value / 1000;
      this.update();
    };
    parts.addEventListener("placed", () => this.changed());
  }

  get index() {
    return "xyz".indexOf(this.axis);
  }

  get offset() {
    const { min, max } = this.stage.box;
    return min.toArray()[this.index] + this.share * (max.toArray()[this.index] - min.toArray()[this.index]);
  }

  state() {
    const { clips, slices, axis, share } = this;
    return { clips, slices, axis, share };
  }

  restore({ axis, share }) {
    this.axis = "xyz".includes(axis) ? axis : "z";
    this.share = Math.min(Math.max(Number(share) || 0, 0), 1);
    byId("plane-offset").value = 1000 * this.share;
  }

  update() {
    showChoice(byId("plane-axis"), this.axis);
    byId("plane").hidden = !(this.clips || this.slices);
    byId("plane-at").textContent = `${this.axis} = ${mm(this.offset, 1)} mm`;
    byId("legend").hidden = !this.slices;
    const planes = this.clips ? [this.clippingPlane()] : [];
    this.parts.setClipping(planes);
    this.cut.show(planes, this.index, this.offset);
    if (!this.slices) this.mesh.visible = false;
    this.changed();
  }

  /** In the world's frame, as in three.js: the side in front of it is kept. */
  clippingPlane() {
    const normal = new THREE.Vector3().setComponent(this.index, -1);
    if (this.axis === "y") normal.negate(); // the view is from the front: objects before it are removed
    const point = new THREE.Vector3().setComponent(this.index, this.offset).addScaledVector(normal, ASIDE * this.stage.radius);
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, point);
    this.stage.root.updateMatrixWorld(true);
    return plane.applyMatrix4(this.stage.root.matrixWorld);
  }

  /** The slice must be updated: request it, soon. */
  changed() {
    if (!this.slices || this.timer) return;
    this.timer = setTimeout(() => {
      this.timer = 0;
      if (this.slices) this.ask();
    }, WAIT_MS);
  }

  async ask() {
    const [i, j] = [0, 1, 2].filter((each) => each !== this.index);
    const { min, max } = this.stage.box;
    const margin = MARGIN * this.stage.radius;
    const [low, high] = [min.toArray(), max.toArray()];
    const origin = [0, 0, 0];
    origin[this.index] = this.offset;
    const side = (k) => high[k] - low[k] + 2 * margin;
    for (const k of [i, j]) origin[k] = low[k] - margin;
    const u = [0, 0, 0];
    const v = [0, 0, 0];
    u[i] = side(i);
    v[j] = side(j);
    const width = Math.max(Math.round(Math.sqrt((MAX_POINTS * side(i)) / side(j))), 2);
    const height = Math.max(Math.floor(MAX_POINTS / width), 2);
    const ticket = ++this.ticket, plane = { origin, u, v, width, height };
    const isWanted = () => this.slices && ticket === this.ticket;
    const values = await this.local.sliced(plane, this.parts.list, isWanted);
    if (values && isWanted()) this.show({ ...plane, values });
  }

  show(slice) {
    const known = slice.values.filter(Number.isFinite);
    const [inside, outside] = [-1, 1].map((sign) => known.reduce((most, value) => (value * sign > most ? value * sign : most), 1e-9));
    const step = niceStep(Math.max(inside, outside) / 9);
    this.paint(slice, (value) => sliceColour(value, value < 0 ? inside : outside), step);
    const [o, u, v] = [slice.origin, slice.u, slice.v].map((each) => new THREE.Vector3(...each));
    const corners = [o, o.clone().add(u), o.clone().add(v), o.clone().add(u).add(v)];
    const geometry = new THREE.BufferGeometry().setFromPoints(corners);
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute([0, 0, 1, 0, 0, 1, 1, 1], 2));
    geometry.setIndex([0, 1, 2, 1, 3, 2]);
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry;
    this.mesh.visible = true;
    const [deepest, farthest] = [inside, outside].map((size) => +(1e3 * size).toPrecision(2));
    byId("legend-low").textContent = inside > 1e-9 ? `−${deepest}` : "";
    byId("legend-high").textContent = `${farthest} mm, lines every ${+(1e3 * step).toPrecision(3)}`;
  }

  /** Colours, a line at every step, and a dark one on the surface. */
  paint({ width, height, values }, colourOf, step) {
    const pixels = new Uint8Array(4 * width * height);
    for (let k = 0; k < values.length; k++) {
      const value = values[k];
      const right = (k + 1) % width ? values[k + 1] : value;
      const above = k + width < values.length ? values[k + width] : value;
      const crosses = (each) => Math.floor(each / step) !== Math.floor(value / step);
      const isSurface = value < 0 !== right < 0 || value < 0 !== above < 0;
      const shade = isSurface ? 0.05 : crosses(right) || crosses(above) ? 0.72 : 1;
      const colour = colourOf(value);
      for (let i = 0; i < 3; i++) pixels[4 * k + i] = 255 * shade * colour[i];
      pixels[4 * k + 3] = 255;
    }
    this.texture?.dispose();
    this.texture = new THREE.DataTexture(pixels, width, height, THREE.RGBAFormat);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.texture.magFilter = this.texture.minFilter = THREE.LinearFilter;
    this.texture.needsUpdate = true;
    this.mesh.material.map = this.texture;
    this.mesh.material.needsUpdate = true;
    this.stage.wake();
  }
}

/** The filled cuts of the parts: where a ray meets more back faces than front faces. */
class Cut {
  constructor(stage, parts) {
    Object.assign(this, { stage, parts });
    this.caps = new Map();
    this.planes = [];
    for (const name of ["placed", "faded"]) parts.addEventListener(name, () => this.follow());
  }

  show(planes, axis, offset) {
    this.planes = planes;
    if (planes.length) for (const part of this.parts.list) if (!this.caps.has(part)) this.caps.set(part, this.capOf(part));
    const place = this.stage.box.getCenter(new THREE.Vector3()).setComponent(axis, offset);
    const turn = new THREE.Euler(axis === 1 ? Math.PI / 2 : 0, axis === 0 ? Math.PI / 2 : 0, 0);
    for (const { cap } of this.caps.values()) {
      cap.position.copy(place);
      cap.rotation.copy(turn);
    }
    this.follow();
  }

  follow() {
    for (const [part, { cap, counters }] of this.caps) {
      cap.visible = this.planes.length > 0 && part.object.visible && !part.isFaint;
      for (const each of counters) [each.visible, each.material.clippingPlanes] = [cap.visible, this.planes];
    }
  }

  capOf(part) {
    const order = 2 * this.caps.size - 1000; // before all else: its faces are counted, the cut is drawn, the count is cleared
    const counters = part.meshes.flatMap((mesh) =>
      [[THREE.BackSide, THREE.IncrementWrapStencilOp], [THREE.FrontSide, THREE.DecrementWrapStencilOp]].map(([side, count]) => {
        const stencil = { stencilWrite: true, stencilFail: count, stencilZFail: count, stencilZPass: count };
        const counter = new THREE.Mesh(mesh.geometry, new THREE.MeshBasicMaterial({ side, colorWrite: false, depthTest: false, depthWrite: false, ...stencil }));
        counter.renderOrder = order;
        mesh.add(counter);
        return counter;
      }),
    );
    const material = new THREE.MeshStandardMaterial({
      color: new THREE.Color(part.colour).lerp(new THREE.Color(0xf2b84b), 0.35), roughness: 0.8, side: THREE.DoubleSide,
      stencilWrite: true, stencilFunc: THREE.NotEqualStencilFunc,
    });
    const cap = new THREE.Mesh(new THREE.PlaneGeometry(20 * this.stage.radius, 20 * this.stage.radius), material);
    cap.renderOrder = order + 1;
    cap.onAfterRender = (renderer) => renderer.clearStencil();
    this.stage.root.add(cap);
    return { cap, counters };
  }
}
