// A typed program in a bundled page: fetches a scene, queries it, and ticks a tracker.
import { ContactFlag, ProximityError, load, type ClosestPoints, type Contact, type ContactFields } from "proximity-engine";

async function told(): Promise<unknown> {
  const engine = await load();
  const scene = await engine.fetch("scene.prox");
  const points = new Float64Array([...scene.bounds.upper, ...scene.bounds.lower]);
  const out: ClosestPoints = scene.closest(points);
  const again: boolean = scene.closest(points, { out }) === out;
  const tracker = scene.tracker(2, { radius: 0.005 });
  const contacts: Contact[] = tracker.tick(points, 1_000_000n, 1_000_000n);
  const kept: ContactFields = contacts[0].copy();
  const isTracked: boolean[] = contacts.map(({ flags }) => (flags & ContactFlag.TRACKED) !== 0);
  const age: bigint = 1_000_000n - kept.pose_ns;
  const page = await engine.fetch("index.html").catch((failure: ProximityError) => failure.message);
  return {
    distances: Array.from(out.signedDistance), again, isTracked, age: Number(age), page,
    lower: kept.lower, point: kept.point_on_part.length, instructions: scene.instructions,
  };
}

const place = document.getElementById("told") as HTMLElement;
told().then((answer) => (place.textContent = JSON.stringify(answer)), (failure) => (place.textContent = String(failure)));
