// Places of points on rigid links, and geometry of the plane. Forces and constraints are computed by the server.
import type { Link, Pin, Pose, Poses, Scene, Slide, XY } from "./protocol";

/** Returns the place in the world of a point in a link's frame. */
export function place([x, y, theta]: Pose, [a, b]: XY): XY {
  const c = Math.cos(theta);
  const s = Math.sin(theta);
  return [x + c * a - s * b, y + s * a + c * b];
}

/** Returns the place in a link's frame of a point in the world. */
export function local([x, y, theta]: Pose, at: XY): XY {
  const c = Math.cos(theta);
  const s = Math.sin(theta);
  return [c * (at[0] - x) + s * (at[1] - y), -s * (at[0] - x) + c * (at[1] - y)];
}

export const apart = (a: XY, b: XY): number => Math.hypot(a[0] - b[0], a[1] - b[1]);
export const between = (a: XY, b: XY, share = 0.5): XY => [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
export const direction = (a: XY, b: XY): number => Math.atan2(b[1] - a[1], b[0] - a[0]);

/** Returns the distance of `at` from the segment a-b, and the nearest point of the segment. */
export function fromSegment(at: XY, a: XY, b: XY): { distance: number; foot: XY } {
  const dx = b[0] - a[0];
  const dy = b[1] - a[1];
  const square = dx * dx + dy * dy;
  const share = square === 0 ? 0 : Math.max(0, Math.min(1, ((at[0] - a[0]) * dx + (at[1] - a[1]) * dy) / square));
  const foot = between(a, b, share);
  return { distance: apart(at, foot), foot };
}

/** Returns the convex hull of points, counter-clockwise. */
export function hull(points: XY[]): XY[] {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turn = (o: XY, a: XY, b: XY) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
  const half = (list: XY[]): XY[] => {
    const out: XY[] = [];
    for (const p of list) {
      while (out.length > 1 && turn(out[out.length - 2]!, out[out.length - 1]!, p) <= 0) out.pop();
      out.push(p);
    }
    return out.slice(0, -1);
  };
  return sorted.length < 3 ? sorted : [...half(sorted), ...half(sorted.reverse())];
}

export function inside(at: XY, polygon: XY[]): boolean {
  let within = false;
  polygon.forEach((a, i) => {
    const b = polygon[(i + 1) % polygon.length]!;
    if (a[1] > at[1] !== b[1] > at[1] && at[0] < a[0] + ((at[1] - a[1]) / (b[1] - a[1])) * (b[0] - a[0])) within = !within;
  });
  return within;
}

/** A scene with other poses of its links; links without an entry in `poses` have the poses of the scene. */
export class Placed {
  private readonly links: Map<string, Link>;
  private readonly poses: Map<string, Pose>; // a Map, because a plain object also has inherited keys such as "constructor"

  constructor(
    readonly scene: Scene,
    poses: Poses,
  ) {
    this.links = new Map(scene.links.map((link) => [link.name, link]));
    this.poses = new Map(Object.entries(poses));
  }

  link(name: string): Link | undefined {
    return this.links.get(name);
  }

  pose(name: string): Pose {
    return this.poses.get(name) ?? this.links.get(name)?.pose ?? [0, 0, 0];
  }

  /** Returns the place in the world of "link.point" or "ground.point"; null if the scene has no such point. */
  point(ref: string): XY | null {
    const dot = ref.lastIndexOf(".");
    const owner = ref.slice(0, dot);
    const name = ref.slice(dot + 1);
    if (owner === "ground") return this.scene.ground.points[name] ?? null;
    const at = this.links.get(owner)?.points[name];
    return at ? place(this.pose(owner), at) : null;
  }

  points(link: Link): [string, XY][] {
    const pose = this.pose(link.name);
    return Object.entries(link.points).map(([name, at]) => [name, place(pose, at)]);
  }

  pin(pin: Pin): XY {
    const moved = pin.members.find((ref) => ref.startsWith("ground.")) ?? pin.members.find((ref) => this.poses.has(ref.split(".")[0]!));
    return (moved && this.point(moved)) || pin.at;
  }

  /** Returns the angle by which a link has turned from its pose in the scene [rad]. */
  private turned(owner: string): number {
    const link = this.links.get(owner);
    return link ? this.pose(owner)[2] - link.pose[2] : 0;
  }

  slide(slide: Slide): { at: XY; angle: number; block: XY } {
    const owner = slide.guide.split(".")[0]!;
    return {
      at: this.point(slide.guide) ?? slide.at,
      angle: slide.angle + this.turned(owner),
      block: (this.poses.has(slide.block.split(".")[0]!) && this.point(slide.block)) || slide.block_at,
    };
  }

  /** Returns the places at which a force acts in the present poses. */
  force(force: { table: Record<string, unknown>; at: XY[] }): XY[] {
    const { between: pair, point, joint, link } = force.table as { between?: string[]; point?: string; joint?: string; link?: string };
    if (Array.isArray(pair)) {
      const ends = pair.map((ref) => this.point(String(ref)));
      if (ends.every((end) => end)) return ends as XY[];
    }
    if (typeof point === "string") {
      const at = this.point(point);
      if (at) return [at, ...force.at.slice(1)];
    }
    if (typeof joint === "string") {
      const pin = this.scene.pins.find((p) => p.joint === joint);
      if (pin) return [this.pin(pin)];
    }
    if (typeof link === "string" && this.links.has(link) && force.at[0]) {
      const body = this.links.get(link)!;
      return [place(this.pose(link), local(body.pose, force.at[0]))];
    }
    return force.at;
  }
}

/** Returns the centre of a link's points in the world. */
export function middle(points: XY[]): XY {
  const n = Math.max(points.length, 1);
  return [points.reduce((sum, p) => sum + p[0], 0) / n, points.reduce((sum, p) => sum + p[1], 0) / n];
}
