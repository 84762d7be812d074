// Finds the part under the pointer, and the place to which a click snaps.
import { apart, fromSegment, hull, inside } from "./geometry";
import type { Placed } from "./geometry";
import type { XY } from "./protocol";
import type { Picked } from "./state";
import { onGrid, toWorld, view } from "./view";

export interface Target {
  at: XY; // place in the world, snapped to a pin, a bar or the grid
  pin: string | null;
  link: string | null; // name of the link whose bar is under the pointer
  over: Picked | null; // the part that a click selects
}

/** Returns the target at a pixel. `reach` is the largest distance [pixels], larger for fingers; `free` switches off the grid. */
export function target(placed: Placed, screen: XY, reach: number, free: boolean): Target {
  const world = toWorld(screen);
  const scale = view.value.scale;
  const near = (at: XY, pixels: number): boolean => apart(at, world) * scale <= pixels;
  let pin: string | null = null;
  let at = world;
  let least = Infinity;
  let moving = false;
  const tie = 0.5 / scale; // half a pixel: of two pins in one place, such as those of a block and its guide, the moving one is chosen
  for (const candidate of placed.scene.pins) {
    const place = placed.pin(candidate);
    const distance = apart(place, world);
    const moves = candidate.members.some((ref) => !ref.startsWith("ground."));
    const nearer = moves === moving ? distance < least : distance < least + (moves ? tie : -tie);
    if (near(place, reach) && nearer) [pin, at, least, moving] = [candidate.id, place, distance, moves];
  }
  if (pin !== null) return { at, pin, link: null, over: { kind: "pin", id: pin } };

  let link: string | null = null;
  let closest = (0.7 * reach) / scale;
  for (const body of placed.scene.links) {
    const points = new Map(placed.points(body));
    for (const [a, b] of body.bars) {
      const [p, q] = [points.get(a), points.get(b)];
      if (!p || !q) continue;
      const { distance, foot } = fromSegment(world, p, q);
      if (distance < closest) [link, at, closest] = [body.name, foot, distance];
    }
  }
  const over = pickForce(placed, near) ?? pickSlide(placed, world, near);
  if (link !== null) return { at, pin: null, link, over: over ?? { kind: "link", id: link } };
  const spot = free ? world : onGrid(world);
  if (over) return { at: spot, pin: null, link: null, over };
  const body = [...placed.scene.links].reverse().find((l) => {
    const points = placed.points(l).map(([, p]) => p);
    return points.length > 2 && inside(world, hull(points));
  });
  return { at: spot, pin: null, link: null, over: body ? { kind: "link", id: body.name } : null };
}

function pickForce(placed: Placed, near: (at: XY, pixels: number) => boolean): Picked | null {
  for (const force of placed.scene.forces) {
    const ends = placed.force(force);
    const hit = ends.length > 1 ? near([(ends[0]![0] + ends[1]![0]) / 2, (ends[0]![1] + ends[1]![1]) / 2], 14) : ends[0] && near(ends[0], 26);
    if (hit) return { kind: "force", id: force.id };
  }
  return null;
}

function pickSlide(placed: Placed, world: XY, near: (at: XY, pixels: number) => boolean): Picked | null {
  for (const slide of placed.scene.slides) {
    const { block, angle } = placed.slide(slide);
    if (near(block, 20)) return { kind: "slide", id: slide.id };
    const reach = 60 / view.value.scale;
    const [dx, dy] = [Math.cos(angle) * reach, Math.sin(angle) * reach];
    const a: XY = [block[0] - dx, block[1] - dy];
    const b: XY = [block[0] + dx, block[1] + dy];
    if (near(fromSegment(world, a, b).foot, 7)) return { kind: "slide", id: slide.id };
  }
  return null;
}
