// Distances of points to a scene: node example.mjs SCENE.prox (Node 22 or newer, or node --experimental-wasm-relaxed-simd).
// In a page: import the same module, and fetch the scene.
import { readFile } from "node:fs/promises";
import { load } from "./proximity.mjs";

const engine = await load();
const scene = engine.open(await readFile(process.argv[2]));
const { lower, upper } = scene.bounds;
const middle = lower.map((coordinate, axis) => (coordinate + upper[axis]) / 2);
const points = new Float64Array([...upper, ...middle]);

const { signedDistance, point, part } = scene.closest(points);
for (let k = 0; k < signedDistance.length; k++) {
  const where = Array.from(point.slice(3 * k, 3 * k + 3), (coordinate) => coordinate.toFixed(6)).join(", ");
  console.log(`${(1000 * signedDistance[k]).toFixed(3)} mm from ${scene.parts[part[k]]}, at (${where}) m`);
}
scene.close();
