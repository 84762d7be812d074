// The tools: the picks (clicks in the drawing) that each needs, and the edit that it makes from them.
import { batch, signal } from "@preact/signals";
import { apart, direction, fromSegment } from "./geometry";
import type { Target } from "./hit";
import type { Reply, XY } from "./protocol";
import { edit, placed, say, scene, selection, still } from "./state";

export type ToolId = "select" | "reshape" | "ground" | "bar" | "link" | "slider" | "spring" | "damper" | "torque" | "force" | "cylinder" | "observe" | "poses" | "picture";

export interface Tool {
  id: ToolId;
  name: string;
  key: string;
  help: string;
  asks: string[]; // a request for each pick
  open?: boolean; // picks end with Enter, a double click or a click on the first point
  make?: (picks: Target[]) => Promise<unknown>;
}

let begun = false; // whether the tool has made an edit: later edits continue it, and are undone together with it

async function change(verb: string, what: object): Promise<Reply | null> {
  const reply = await edit(verb, begun ? { ...what, continues: true } : what);
  begun ||= reply !== null;
  return reply;
}

/** Makes an edit and returns the id of its new pin; null if the edit is refused. */
async function made(verb: string, what: object): Promise<string | null> {
  const reply = await change(verb, what);
  const ids = (reply?.made ?? []) as string[];
  return ids.find((id) => id.startsWith("pins."))?.slice(5) ?? null;
}

/** Returns the pin at a pick, else a new point of the link there, else the place. */
async function end(pick: Target): Promise<{ pin: string } | { at: XY }> {
  if (pick.pin !== null) return { pin: pick.pin };
  if (pick.link !== null) {
    const pin = await made("add_point", { link: pick.link, at: pick.at });
    if (pin) return { pin };
  }
  return { at: pick.at };
}

async function ends(picks: Target[]): Promise<({ pin: string } | { at: XY })[]> {
  const out = [];
  for (const pick of picks) out.push(await end(pick));
  return out;
}

/** Returns the link under a pick: that of a bar, the selected link, or the first moving link of the pin. */
export function linkOf(pick: Target): string | null {
  if (pick.link) return pick.link;
  if (pick.over?.kind === "link") return pick.over.id;
  const pin = scene.value?.pins.find((p) => p.id === pick.pin);
  return pin?.members.map((ref) => ref.split(".")[0]!).find((name) => name !== "ground") ?? null;
}

const pointOf = (id: string): string | null => scene.value?.pins.find((p) => p.id === id)?.members.find((ref) => !ref.startsWith("ground.")) ?? null;

/** Adds a force between two picks; a pick on an empty place gets a new pivot on the ground. */
async function connectTwo(type: string, picks: Target[], values: object): Promise<unknown> {
  const held: string[] = [];
  for (const pick of picks) {
    let at = await end(pick);
    if ("at" in at) {
      const pin = await made("add_pin", { at: pick.at, ground: true });
      if (!pin) return null;
      at = { pin };
    }
    held.push(at.pin);
  }
  return change("add_force", { type, a: held[0], b: held[1], ...values });
}

async function slider(picks: Target[]): Promise<unknown> {
  const [block, guide] = picks as [Target, Target];
  const on = guide.link ?? (guide.over?.kind === "link" ? guide.over.id : null);
  const own = scene.value?.pins.find((p) => p.id === block.pin)?.members.map((ref) => ref.split(".")[0]) ?? [];
  const what = block.pin !== null ? { pin: block.pin } : { at: block.at };
  if (on && !own.includes(on)) {
    const body = placed.value!.link(on)!;
    const points = new Map(placed.value!.points(body));
    const bars = body.bars.map(([a, b]) => [points.get(a)!, points.get(b)!] as [XY, XY]);
    bars.sort((p, q) => fromSegment(guide.at, ...p).distance - fromSegment(guide.at, ...q).distance);
    const [a, b] = bars[0] ?? [guide.at, block.at];
    return change("add_slide", { ...what, guide: on, through: a, angle_deg: (direction(a, b) * 180) / Math.PI });
  }
  const turned = (direction(block.at, guide.at) * 180) / Math.PI;
  return change("add_slide", { ...what, guide: "ground", through: block.at, angle_deg: Number(turned.toFixed(6)) });
}

async function force(picks: Target[]): Promise<unknown> {
  const [from, to] = picks as [Target, Target];
  const where = await end(from);
  const length = apart(from.at, to.at) || 1;
  const value = [0, 1].map((i) => Number(((10 * (to.at[i]! - from.at[i]!)) / length).toPrecision(6)));
  const point = "pin" in where ? pointOf(where.pin) : null;
  if (!point) {
    say("A force needs a point of a moving link: click on a bar or a pin first.", "error");
    return null;
  }
  return change("add_force", { type: "force", point, value });
}

async function torque(picks: Target[]): Promise<unknown> {
  const link = linkOf(picks[0]!);
  if (link) return change("add_force", { type: "torque", link, value: 1 });
  say("A torque needs a link: click on one of its bars.", "error");
  return null;
}

async function observe(picks: Target[]): Promise<unknown> {
  const pick = picks[0]!;
  const link = linkOf(pick);
  if (!link) {
    say("Only points of moving links can be observed: click on a bar, a plate or a pin.", "error");
    return null;
  }
  const point = pointOf(pick.pin ?? (await made("add_point", { link, at: pick.at })) ?? "");
  return point && change("observe", { point, on: !scene.value!.observe.includes(point) });
}

export const TOOLS: Tool[] = [
  { id: "select", name: "Select", key: "v", help: "Select things, and drag a joint to move the linkage. Drag empty space to move the view.", asks: [] },
  { id: "reshape", name: "Reshape", key: "m", help: "Drag a joint to another place: the lengths of its links change, and are shown as you drag. Drop it on another joint to join both.", asks: [] },
  {
    id: "ground",
    name: "Ground pivot",
    key: "g",
    help: "A pin that is fixed to the ground. Click a place, or a pin to be fixed.",
    asks: ["Click a place or a pin"],
    make: ([pick]) => (pick!.pin !== null ? change("ground", { pin: pick!.pin, on: true }) : change("add_pin", { at: pick!.at, ground: true })),
  },
  {
    id: "bar",
    name: "Bar",
    key: "b",
    help: "A rigid bar between two places. Ends that meet a pin are joined to it.",
    asks: ["Click where the bar starts", "Click where it ends"],
    make: async (picks) => {
      const [from, to] = await ends(picks);
      return change("add_bar", { from, to });
    },
  },
  {
    id: "link",
    name: "Link",
    key: "l",
    help: "A rigid link with three or more joints. Click its corners; Enter or a click on the first ends it.",
    asks: ["Click the first corner", "Click the second corner", "Click the third corner", "Another corner, or Enter to end"],
    open: true,
    make: async (picks) => change("add_link", { points: await ends(picks) }),
  },
  {
    id: "slider",
    name: "Slider",
    key: "s",
    help: "A block with a pin that slides along a straight guide on the ground, or along a bar (a pin in a slot).",
    asks: ["Click the pin that will slide", "Click a bar as the slot, or a place on the ground to which the line leads"],
    make: slider,
  },
  {
    id: "spring",
    name: "Spring",
    key: "k",
    help: "A spring between two points.",
    asks: ["Click one end of the spring", "Click its other end"],
    make: (picks) => connectTwo("spring_damper", picks, { k: 100, rest: Number((0.8 * apart(picks[0]!.at, picks[1]!.at)).toPrecision(3)) }),
  },
  {
    id: "damper",
    name: "Damper",
    key: "d",
    help: "A damper between two points.",
    asks: ["Click one end of the damper", "Click its other end"],
    make: (picks) => connectTwo("damper", picks, {}),
  },
  { id: "torque", name: "Torque", key: "t", help: "A torque on a link, such as a motor's.", asks: ["Click the link that is turned"], make: torque },
  { id: "force", name: "Force", key: "f", help: "A force on a point of a link.", asks: ["Click the point it acts on", "Click where it pulls to"], make: force },
  {
    id: "cylinder",
    name: "Cylinder",
    key: "c",
    help: "An actuator between two pins whose length is driven.",
    asks: ["Click the cylinder's foot", "Click the rod's end"],
    make: (picks) => connectTwo("cylinder", picks, {}),
  },
  { id: "observe", name: "Observe", key: "o", help: "A point of a link whose path, velocity and acceleration are shown.", asks: ["Click a point, or a place on a link"], make: observe },
  {
    id: "poses",
    name: "Poses",
    key: "q",
    help: "Give three poses of a coupler, each by two of its points, and find a four-bar that passes through them.",
    asks: [
      ...["first", "second", "third"].flatMap((n) => [`Click the first pin in the ${n} pose`, n === "first" ? "Click the second pin" : "Click where the second pin points to"]),
      ...["", ""], // two fixed pivots, which the bar beside the drawing requests
    ],
    make: async (list) => void (posed.value = list.map((p) => p.at)),
  },
  { id: "picture", name: "Picture", key: "p", help: "A picture behind the grid to draw over, scaled by two points of known distance.", asks: ["Click the first of two points of the picture", "Click the second"] },
];

export const posed = signal<XY[] | null>(null); // the places of three poses and two fixed pivots
export const tool = signal<ToolId>("select");
export const picks = signal<Target[]>([]);
export const hover = signal<Target | null>(null);
export const current = (): Tool => TOOLS.find((t) => t.id === tool.value)!;

export function choose(id: ToolId): void {
  batch(() => {
    tool.value = id;
    posed.value = null;
    picks.value = [];
    hover.value = null;
    if (id !== "select") still();
    if (id !== "select" && id !== "reshape") selection.value = [];
  });
}

export const pictureScaled = signal<((a: XY, b: XY) => void) | null>(null);
let busy: Promise<unknown> = Promise.resolve();

/** Adds a pick of the chosen tool, and makes the edit after the last pick. Edits are made one after the other. */
export function pick(next: Target): void {
  const hand = current();
  if (!hand.asks.length) return;
  if (posed.value) return;
  const list = [...picks.value];
  const before = list.at(-1);
  const same = before && apart(before.at, next.at) < 1e-9;
  if (hand.open && list.length > 2 && apart(list[0]!.at, next.at) < 1e-9) return finish();
  if (same) return hand.open && list.length > 2 ? finish() : undefined;
  picks.value = [...list, next];
  if (!hand.open && picks.value.length === hand.asks.length) finish();
}

/** Makes the edit of the chosen tool with the present picks. */
export function finish(): void {
  const hand = current();
  const list = picks.value;
  if (hand.open && list.length < 3) {
    say("A link has three corners or more; a bar has two.", "error");
    return;
  }
  picks.value = [];
  if (hand.id === "picture") pictureScaled.value?.(list[0]!.at, list[1]!.at);
  else {
    busy = busy.then(() => {
      begun = false;
      return hand.make?.(list);
    });
  }
}

/** Esc: cancels the present picks; without picks the tool; with the tool Select the selection. */
export function cancel(): void {
  if (picks.value.length) picks.value = [];
  else if (tool.value !== "select") choose("select");
  else selection.value = [];
}

export async function remove(): Promise<void> {
  const plural = { link: "links", pin: "pins", slide: "slides", force: "forces" };
  const ids = selection.value.map((p) => `${plural[p.kind]}.${p.id}`);
  if (ids.length) await edit("delete", { ids });
}
