// Points from a text, such as a scan: coloured by their signed distance, with a table, and as CSV.

import * as THREE from "three";
import { css, sliceColour } from "../colours.js";
import { mm } from "../frames.js";
import { byId, made, offer, setText } from "../panel.js";
import { niceStep } from "../stage.js";

const MAX_AT_ONCE = 4000; // points, before pictures are updated
const WAIT_MS = 150; // until moving parts stop
const UNITS = { m: 1, cm: 1e-2, mm: 1e-3, um: 1e-6, in: 0.0254, ft: 0.3048 };
const ROWS = ["points", "min", "max", "mean", "RMS", "50 % within", "95 % within", "99 % within"];
const NEAR = 14; // half pixels from the mouse, to pick a point
const MAX_TRIED = 8;
const DEEPEST = 0.1; // below a surface, of the parts' size, at which points still show through
const isNumber = (word) => word !== "" && (Number.isFinite(Number(word)) || /^[+-]?(nan|inf)/i.test(word));

export class PointCloud {
  constructor(stage, parts, local, panel) {
    Object.assign(this, { stage, parts, local, panel });
    this.unit = 1e-3; // m
    this.ticket = 0;
    this.before = { value: 0 }; // m by which points are drawn nearer to the eye
    byId("points-range").onchange = ({ target }) => this.paint(Math.max(Number(target.value) / 1e3, 1e-9));
    byId("points-csv").onclick = () => this.save();
    byId("points-close").onclick = () => this.clear();
    byId("points-file").onchange = ({ target }) => this.read(target.files[0]).then(() => (target.value = ""));
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      this.read(event.dataTransfer.files[0]);
    });
    parts.addEventListener("placed", () => {
      clearTimeout(this.timer);
      if (this.object) this.timer = setTimeout(() => this.object && this.measure(), WAIT_MS);
    });
  }

  async read(file) {
    if (!file) return;
    try {
      await this.show(file.name, parsePoints(await file.text(), file.name, this.unit));
    } catch (failure) {
      this.panel.say(failure.message);
    }
  }

  /** Show points, three numbers each, m, scene frame. */
  async show(name, coordinates) {
    this.clear();
    Object.assign(this, { name, coordinates, count: coordinates.length / 3, range: undefined });
    if (!this.count) return this.panel.say(`${name} has no points.`);
    await this.measure();
  }

  clear() {
    this.ticket += 1;
    this.name = "";
    byId("points-card").hidden = true;
    this.object?.removeFromParent();
    this.object?.geometry.dispose();
    this.object = null;
  }

  async measure() {
    const ticket = ++this.ticket, { local, coordinates, count } = this;
    const scene = await local.open();
    const [distances, part, isSigned] = [new Float64Array(count), new Int32Array(count), new Int32Array(count)];
    for (let first = 0; first < count; first += MAX_AT_ONCE) {
      if (ticket !== this.ticket) return;
      local.follow(scene, this.parts.list);
      const found = scene.closest(coordinates.subarray(3 * first, 3 * (first + MAX_AT_ONCE)));
      distances.set(found.signedDistance, first);
      part.set(found.part, first);
      isSigned.set(found.isSigned, first);
      await new Promise((next) => setTimeout(next));
    }
    if (ticket !== this.ticket) return;
    const known = distances.filter(Number.isFinite).sort(), sizes = known.map(Math.abs).sort();
    Object.assign(this, { distances, part, isSigned, known, sizes });
    this.before.value = Math.min(Math.max(-1.1 * (known[0] ?? 0), 1e-6), DEEPEST * this.stage.radius);
    if (!this.object) this.draw();
    this.paint(this.range ?? niceStep(this.share(0.95) || 1e-3));
  }

  draw() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(this.coordinates), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * this.count), 3));
    const material = new THREE.PointsMaterial({ size: 5, sizeAttenuation: false, vertexColors: true, toneMapped: false });
    material.onBeforeCompile = (shader) => {
      shader.uniforms.before = this.before;
      shader.vertexShader = `uniform float before;\n${shader.vertexShader}`.replace("#include <project_vertex>",
        "#include <project_vertex>\ngl_Position = projectionMatrix * vec4(mvPosition.xyz * max(1.0 - before / length(mvPosition.xyz), 0.1), 1.0);");
    };
    this.object = new THREE.Points(geometry, material);
    this.object.frustumCulled = false;
    this.object.onBeforeRender = () => (material.clippingPlanes = this.parts.clipping);
    this.stage.root.add(this.object);
  }

  /** The row of the visible point nearest to *pointer*, -1 to 1 across the view; -1 if none is near. */
  under(pointer) {
    if (!this.object) return -1;
    const { camera, root } = this.stage, near = NEAR / innerHeight, found = [], [place, seen] = [new THREE.Vector3(), new THREE.Vector3()];
    const toView = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).multiply(root.matrixWorld);
    for (let k = 0; k < this.count; k++) {
      seen.fromArray(this.coordinates, 3 * k).applyMatrix4(toView);
      const away = Math.hypot((seen.x - pointer.x) * camera.aspect, seen.y - pointer.y);
      if (away < near && seen.z < 1) found.push([away, k]);
    }
    const eye = this.stage.toScene(camera.position);
    const isSeen = ([, k]) => {
      const at = place.fromArray(this.coordinates, 3 * k), world = this.stage.toWorld(at);
      if (this.parts.clipping.some((plane) => plane.distanceToPoint(world) < 0)) return false;
      const ray = new THREE.Ray(world, camera.position.clone().sub(world).normalize()), way = eye.clone().sub(at).normalize();
      const end = Math.min(world.distanceTo(camera.position), ...this.parts.clipping.map((plane) => ray.distanceToPlane(plane) ?? Infinity));
      const free = end - this.before.value;
      if (free <= 0) return true;
      return this.local.scene.cast(at.addScaledVector(way, this.before.value).toArray(), way.toArray(), { maxDistance: free }).part[0] < 0;
    };
    return found.sort(([one], [other]) => one - other).slice(0, MAX_TRIED).find(isSeen)?.[1] ?? -1;
  }

  /** Colour the points: *range*, m, is at the ends of the bar. */
  paint(range) {
    this.range = range;
    const colours = this.object.geometry.getAttribute("color"), colour = new THREE.Color();
    this.distances.forEach((distance, k) => {
      colour.setRGB(...(Number.isFinite(distance) ? sliceColour(distance, range) : [0.5, 0.5, 0.5]), THREE.SRGBColorSpace);
      colour.toArray(colours.array, 3 * k);
    });
    colours.needsUpdate = true;
    byId("points-card").hidden = false;
    byId("points-range").value = +(1e3 * range).toPrecision(4);
    this.tell();
    this.stage.wake();
  }

  /** The magnitude of distance not exceeded by this share of the points. */
  share(share) {
    return this.sizes[Math.max(Math.ceil(share * this.sizes.length) - 1, 0)];
  }

  tell() {
    const { known, sizes, range } = this;
    const sum = (numbers, of) => numbers.reduce((total, each) => total + of(each), 0) / numbers.length;
    const lengths = [known[0], known.at(-1), sum(known, (each) => each), Math.sqrt(sum(known, (each) => each * each)), ...[0.5, 0.95, 0.99].map((each) => this.share(each))];
    const within = (100 * sizes.filter((each) => each <= range).length) / sizes.length;
    const values = [this.count.toLocaleString("en").replaceAll(",", " "), ...lengths.map((each) => `${mm(each, 3)} mm`), `${within.toFixed(1)} %`];
    byId("points-table").replaceChildren(...[...ROWS, `within ±${+(1e3 * range).toPrecision(4)} mm`].flatMap((name, k) => [made("dt", name), made("dd", values[k])]));
    setText(byId("points-name"), `${this.name}: RMS ${values[4]}`);
    const unknown = this.isSigned.filter((each, k) => !each && this.part[k] >= 0).length;
    setText(byId("points-note"), unknown ? `Inside and outside are not known for ${unknown} of them: their distances are positive.` : "");
  }

  /** Draw the colour bar of the points into a picture: the file's name and RMS above it, its range below. */
  drawBar(context) {
    if (!this.object) return;
    context.fillStyle = "rgba(17, 21, 28, 0.85)";
    context.fillRect(14, 14, 300, 78);
    const bar = context.createLinearGradient(28, 0, 300, 0);
    for (let k = 0; k <= 20; k++) bar.addColorStop(k / 20, css(sliceColour(k / 10 - 1, 1)));
    context.fillStyle = bar;
    context.fillRect(28, 46, 272, 12);
    context.fillStyle = "#f4f6f9";
    context.font = "600 13px system-ui, 'Segoe UI', Roboto, Arial, sans-serif";
    context.fillText(byId("points-name").textContent, 28, 35, 272);
    const end = +(1e3 * this.range).toPrecision(4), words = [`−${end} mm inside`, "0", `${end} mm outside`];
    ["left", "center", "right"].forEach((align, k) => {
      context.textAlign = align;
      context.fillText(words[k], 28 + 136 * k, 78);
    });
  }

  /** Offer the points with their distances, with the columns of `proximity query --csv`. */
  save() {
    const lines = ["x_mm,y_mm,z_mm,signed_distance_mm,is_signed,part_name"];
    const quoted = this.parts.list.map(({ name }) => (/[",\n]/.test(name) ? `"${name.replaceAll('"', '""')}"` : name));
    const shown = (metres) => (Number.isFinite(metres) ? +(1e3 * metres).toPrecision(15) : "nan");
    for (let k = 0; k < this.count; k++) {
      const point = [...this.coordinates.subarray(3 * k, 3 * k + 3), this.distances[k]].map(shown);
      lines.push([...point, Boolean(this.isSigned[k]), quoted[this.part[k]] ?? ""].join());
    }
    offer(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }), `${this.name.replace(/\.\w+$/, "")}-distances.csv`);
  }
}

/**
 * The points of a text, m. A line has three numbers separated by commas, semicolons or spaces; the first line may name
 * the columns, x, y and z among them, and their unit; otherwise they are in *unit*, m. Lines that begin with # are
 * comments.
 */
export function parsePoints(text, name, unit) {
  const found = [];
  let axes = null, scale = unit;
  text.replace(/^\ufeff/, "").split(/\r?\n/).forEach((line, row) => {
    const said = line.replace(/(^|\s)#.*/, "").trim();
    if (!said) return;
    const separator = said.includes(",") ? "," : said.includes(";") ? ";" : /\s+/;
    const fields = said.split(separator).map((field) => field.trim().replace(/^"(.*)"$/, "$1"));
    const isHeader = axes === null && !fields.some(isNumber);
    if (isHeader) {
      const words = fields.map((field) => field.toLowerCase().split(/[^a-z]+/).filter(Boolean));
      axes = ["x", "y", "z"].map((axis) => words.findIndex(([first]) => first === axis));
      if (axes.includes(-1)) throw new Error(`${name}, line ${row + 1}: expected three numbers, or columns named x, y and z.`);
      scale = UNITS[words[axes[0]][1]] ?? scale;
      return;
    }
    axes ??= [0, 1, 2];
    const point = axes.map((column) => fields[column] ?? "");
    if (!point.every(isNumber)) throw new Error(`${name}, line ${row + 1}: expected three numbers, with decimal points.`);
    found.push(...point.map((word) => scale * Number(word)));
  });
  return new Float64Array(found);
}
