// Five signed points a call, by the engine and by three-mesh-bvh: for Node (node compare.mjs FOLDER) and for a page.

const CALL = 5; // points
const ROUNDS = 120; // the fastest one counts, as other programs disturb others
const CALLS = 50; // of each, one after the other, in a round

/** given* returns files of a folder by name, *engine* and *bvh* are the modules; returns microseconds a call, and
 * the differences of answers. */
export async function compare(given, engine, three, bvh) {
  const { signed, triangles, points } = {
    signed: new Float64Array(await given("signed.bin")),
    triangles: new Float32Array(await given("triangles.bin")),
    points: new Float64Array(await given("points.bin")),
  };
  const scenes = {};
  for (const name of ["relaxed", "plain"]) {
    if (name === "relaxed" && !engine.hasRelaxed()) continue;
    scenes[name] = (await engine.load(await given(`proximity.${name}.wasm`))).open(await given("scene.prox"));
  }
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(triangles, 3));
  const began = performance.now();
  const tree = new bvh.MeshBVH(geometry);
  const report = { buildMs: performance.now() - began, apart: {}, us: {}, faces: triangles.length / 9 };

  const place = new three.Vector3(), target = {};
  const unsigned = (k) => tree.closestPointToPoint(place.fromArray(points, 3 * k), target).distance;
  for (const [name, scene] of Object.entries(scenes)) {
    const found = scene.signedDistance(points);
    report.apart[name] = found.reduce((most, each, k) => Math.max(most, Math.abs(each - signed[k])), 0);
  }
  report.apart.bvh = signed.reduce((most, each, k) => Math.max(most, Math.abs(Math.abs(each) - unsigned(k))), 0);

  const out = new Float64Array(CALL), groups = points.length / 3 / CALL;
  const few = Array.from({ length: groups }, (_, k) => points.slice(3 * CALL * k, 3 * CALL * (k + 1)));
  const ways = { bvh: (k) => { for (let at = 0; at < CALL; at++) unsigned(CALL * k + at); } };
  for (const [name, scene] of Object.entries(scenes)) ways[name] = (k) => scene.signedDistance(few[k], out);
  const times = Object.fromEntries(Object.keys(ways).map((name) => [name, []]));
  for (let round = 0, k = 0; round < ROUNDS; round++) {
    for (const [name, ask] of Object.entries(ways)) {
      const start = performance.now();
      for (let call = 0; call < CALLS; call++) ask((k + call) % groups);
      times[name].push((1000 * (performance.now() - start)) / CALLS);
    }
    k += CALLS;
  }
  for (const [name, each] of Object.entries(times)) report.us[name] = Math.min(...each);
  return report;
}

if (typeof process !== "undefined" && process.argv[2]) {
  const { readFile } = await import("node:fs/promises");
  const { pathToFileURL } = await import("node:url");
  const folder = pathToFileURL(`${process.argv[2]}/`);
  const given = async (name) => {
    const bytes = await readFile(new URL(name, folder));
    return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  };
  const modules = ["proximity.mjs", "three.mjs", "bvh.mjs"].map((name) => import(new URL(name, folder)));
  console.log(JSON.stringify(await compare(given, ...(await Promise.all(modules)))));
}
