// State of the page: the scene, the selection, and what is shown over the scene. Every change of the linkage uses `edit`.
import { batch, computed, signal } from "@preact/signals";
import { Placed } from "./geometry";
import type { Event, Hello, Motion, Pose, Poses, Reply, Scene, XY } from "./protocol";
import { Refused, ask, connect, listen } from "./socket";
import { fit, view, within } from "./view";

export type Picked = { kind: "link" | "pin" | "slide" | "force"; id: string };

export const hello = signal<Hello | null>(null);
export const scene = signal<Scene | null>(null);
export const selection = signal<Picked[]>([]);
export const said = signal<{ text: string; level: "error" | "notice" | "info"; field?: string } | null>(null); // the status line, which screen readers read aloud
export const dialog = signal<"" | "gallery" | "open" | "share" | "release" | "recommend" | "help" | "export" | "save" | "branches">("");
export const sheet = signal<"" | "properties" | "curves">(""); // on narrow screens, the panel that covers the drawing
export const touring = signal(-1);

// Shown over the scene
export const dragged = signal<Poses | null>(null);
export const trial = signal<Scene | null>(null); // the drawing after the move of a pin that is being tried
export const drawn = computed(() => trial.value ?? scene.value);
export const behind = signal<{ id: string; url: string } | null>(null); // the picture behind the grid
export const motion = signal<Motion | null>(null);
export const moving = signal(false); // whether the motion is shown instead of the sketch
export const playing = signal(false);
export const clock = signal(0); // shown time of the motion [s]
export const pace = signal(1);
export const ghost = signal<{ engine: string; times: number[]; poses: Record<string, [number, number, number][]> } | null>(null);
export const showCentres = signal(false);
export const lined = signal(true); // whether clicks snap to the grid
export const frames = signal({ solved: 0, ms: 0, jump: 0 });

const FLIES = 4; // a motion larger than this multiple of the window that shows the sketch is not fitted into the window
let fitting = false;
let fitted = -Infinity; // time at which the motion was last fitted into the window [ms]

/** Whether the layout may still change because the curves of a motion that was just fitted appear. */
export const settling = (): boolean => performance.now() - fitted < 500;

/** Returns the places of all pins and observed points in every eighth sample of the motion. */
const swept = (): XY[] => {
  const now = motion.value;
  if (!now || !scene.value) return [];
  const out: XY[] = Object.values(now.points).flatMap(({ p }) => p.filter((_, i) => i % 8 === 0));
  for (let i = 0; i < now.times.length; i += 8) {
    const at = new Placed(scene.value, Object.fromEntries(Object.entries(now.poses).flatMap(([name, list]) => (list[i] ? [[name, list[i]]] : []))));
    for (const pin of scene.value.pins) out.push(at.pin(pin));
  }
  return out;
};

/** Fits the whole linkage into the window, with its motion as soon as that is known. */
export function show(): void {
  fit(scene.value, swept());
  fitting = motion.value === null && (scene.value?.links.length ?? 0) > 0;
}

/** Whether the window shows the whole sketch. */
export const inView = (): boolean => within(scene.value);

/** Fits a motion that leaves the window into it, unless the motion is more than FLIES times as large. */
export function follow(): void {
  const before = view.value;
  if (within(scene.value, swept())) return;
  show();
  if (view.value.scale < before.scale / FLIES) view.value = before;
}

/** Returns the index of the sample before a time, and the share of the interval to the next sample that has passed. */
export const sampled = (times: number[], at: number): [number, number] => {
  const last = times.length - 1;
  const i = at >= (times[last] ?? 0) ? Math.max(last - 1, 0) : Math.max(0, times.findIndex((t) => t >= at) - 1);
  const t0 = times[i] ?? 0;
  const t1 = times[i + 1] ?? t0;
  return [i, t1 > t0 ? Math.max(0, Math.min(1, (at - t0) / (t1 - t0))) : 0];
};

const interpolate = (times: number[], poses: Record<string, [number, number, number][]>, at: number): Poses => {
  const [i, share] = sampled(times, at);
  return Object.fromEntries(
    Object.entries(poses).flatMap(([name, list]) => {
      const a = list[i];
      const b = list[i + 1] ?? a;
      return a && b ? [[name, a.map((v, k) => v + share * (b[k]! - v)) as Pose]] : [];
    }),
  );
};

/** The shown poses: those of the drag, else of the motion; empty for those of the scene. */
export const shown = computed<Poses>(() => {
  if (dragged.value) return dragged.value;
  if (moving.value && motion.value) return interpolate(motion.value.times, motion.value.poses, clock.value);
  return {};
});
export const placed = computed(() => (drawn.value ? new Placed(drawn.value, shown.value) : null));
export const ghosted = computed(() =>
  scene.value && ghost.value && moving.value ? new Placed(scene.value, interpolate(ghost.value.times, ghost.value.poses, clock.value)) : null,
);
export const chosen = (kind: Picked["kind"], id: string): boolean => selection.value.some((p) => p.kind === kind && p.id === id);

/** Shows a sentence in the status line, which screen readers read aloud; a sentence of level "info" disappears after 6 s. */
export function say(text: string, level: "error" | "notice" | "info" = "info"): void {
  const word = { text, level };
  said.value = word;
  if (level === "info") setTimeout(() => said.value === word && (said.value = null), 6000);
}

/** Sends a request; returns null after a refusal, and shows its sentence in the status line. */
export async function attempt(verb: string, what: object = {}): Promise<Reply | null> {
  try {
    const reply = await ask(verb, what);
    if (said.value?.level === "error") said.value = null;
    return reply;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    said.value = { text: error.fault.text, level: "error", field: error.fault.field };
    return null;
  }
}

export function take(next: Scene): void {
  const before = scene.value;
  batch(() => {
    const other = scene.value && scene.value.revision !== next.revision;
    scene.value = next;
    dragged.value = trial.value = null;
    if (other || !motion.value) {
      moving.value = playing.value = false;
      ghost.value = null;
    }
    const there = (p: Picked) =>
      p.kind === "link"
        ? next.links.some((l) => l.name === p.id)
        : (p.kind === "pin" ? next.pins : p.kind === "slide" ? next.slides : next.forces).some((x) => x.id === p.id);
    selection.value = selection.value.filter(there);
  });
  if (!before) show();
  void look(next.picture?.id ?? null);
  keep();
  refresh();
}

/** Requests the picture that a scene names, unless the page has it already. */
async function look(id: string | null): Promise<void> {
  if (id === (behind.value?.id ?? null)) return;
  behind.value = null;
  const reply = id && (await attempt("behind"));
  if (reply && reply.picture === scene.value?.picture?.id) behind.value = { id, url: String(reply.url) };
}

/** Whether another drawing may be opened: the present one is saved, or the user confirms. */
const leaving = (): boolean =>
  !scene.value?.unsaved || !scene.value.links.length || confirm(`${scene.value.name} has changes that are not saved. Leave them?`);

/** Resets motion, selection and window after another linkage has been opened. */
export function anew(): void {
  motion.value = null;
  selection.value = [];
  clock.value = 0;
  show();
}

/** Opens another drawing if the user agrees; returns the reply, or null if the present drawing stays. */
export async function open(what: object, verb = "open"): Promise<Reply | null> {
  const reply = leaving() ? await edit(verb, what) : null;
  if (reply) anew();
  return reply;
}

/** Opens the linkage that the address contains, and removes it from the address. */
async function arrive(): Promise<void> {
  const fragment = location.hash.slice(1);
  if (!fragment) return;
  history.replaceState(null, "", location.pathname + location.search);
  await open({ fragment });
}

/** Restores the unsaved changes that an ended server has kept; with `take` false, discards them. */
export async function recover(take: boolean): Promise<void> {
  if (!(await edit("recover", { take }))) return;
  hello.value = { ...hello.value!, recovered: null }; // the changes are offered only once
  if (take) anew();
}

/** Makes an edit and shows the new scene; returns the reply, or null if the server refuses the edit. */
export async function edit(verb: string, what: object = {}): Promise<Reply | null> {
  fitting = false; // an edit does not change the window
  const reply = await attempt(verb, what);
  if (reply?.scene) newer(reply.scene);
  if (reply && "recovered" in reply) hello.value = { ...hello.value!, recovered: reply.recovered as Hello["recovered"] };
  return reply;
}

/** Shows a scene, unless a newer one of another page is shown already; returns whether it is shown. */
function newer(next: Scene): boolean {
  if (next.revision < (scene.value?.revision ?? 0)) return false;
  take(next);
  return true;
}

// The motion is computed again a quarter of a second after the last edit.
let later: ReturnType<typeof setTimeout> | undefined;
let wanted = 0;
export const motionNote = signal("");

const OPEN = "The linkage does not assemble and cannot move: see the problems.";
const FAST = "Nothing can move: there is no degree of freedom. Delete a link, or release a pin from the ground.";
const LOOSE = "Nothing can be driven yet: pin a link to the ground.";

/** Computes the driven motion of the scene again, after a delay in which further edits may follow. */
export function refresh(): void {
  clearTimeout(later);
  const mine = ++wanted;
  const now = scene.value;
  const driven = now?.scenarios.some((s) => s.kind === "driven");
  const fast = now?.status.dof === 0;
  if (!now || !now.status.assembles || fast || !(driven || now.drivers_possible.length)) {
    motion.value = null;
    motionNote.value = !now?.links.length ? "" : !now.status.assembles ? OPEN : fast ? FAST : LOOSE;
    return;
  }
  later = setTimeout(() => void compute(mine), 250);
}

async function compute(mine: number): Promise<void> {
  try {
    const reply = await ask("motion", { samples: 180 });
    if (mine !== wanted) return;
    batch(() => {
      motion.value = ((reply as { motion?: Motion }).motion ?? reply) as unknown as Motion;
      clock.value = Math.min(clock.value, motion.value.times.at(-1) ?? 0);
      motionNote.value = motion.value.note ?? "";
    });
    if (fitting && !dragged.value) { // a drag that has begun keeps its window
      fit(scene.value, swept());
      fitted = performance.now();
    }
    fitting = false;
  } catch (error) {
    if (mine !== wanted || !(error instanceof Refused)) return;
    motion.value = null;
    motionNote.value = error.fault.text;
  }
}

/** Returns the present motion, which is computed if it is not known yet; null if there is none. */
export async function ready(): Promise<Motion | null> {
  if (!motion.value && scene.value?.status.assembles && scene.value.status.dof !== 0 && scene.value.links.length) {
    clearTimeout(later);
    await compute(++wanted);
  }
  return motion.value;
}

export async function play(): Promise<void> {
  if (playing.value) {
    playing.value = false;
    return;
  }
  const now = await ready();
  if (!now) {
    say(motionNote.value || "There is no motion to play.", "error");
    return;
  }
  const began = !moving.value;
  batch(() => {
    if (clock.value >= (now.times.at(-1) ?? 0)) clock.value = 0;
    moving.value = true;
    playing.value = true;
  });
  if (began && inView()) follow(); // a window that shows a part of the drawing stays
  let before = performance.now();
  const step = (t: number): void => {
    if (!playing.value || !motion.value) return;
    const end = motion.value.times.at(-1) ?? 0;
    const next = clock.value + ((t - before) / 1000) * pace.value;
    before = t;
    clock.value = end > 0 && next > end ? next % end : next;
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

export function scrub(at: number): void {
  batch(() => {
    playing.value = false;
    moving.value = motion.value !== null;
    clock.value = at;
  });
}

/** Shows the sketch, which edits change, instead of the motion. */
export function still(): void {
  batch(() => {
    playing.value = false;
    moving.value = false;
  });
}

// A copy of the file's text, which the user can save from the page after the server has ended.
let keeping: ReturnType<typeof setTimeout> | undefined;
export const copy = signal("");

function keep(): void {
  clearTimeout(keeping);
  keeping = setTimeout(async () => {
    const reply = await ask("text").catch(() => null); // without a reply the page keeps its older copy; the server has one too
    if (reply) copy.value = String(reply.text ?? "");
  }, 300);
}

/** Connects to the server, and sends `hello` whenever the socket opens. */
export function start(onEvent: (event: Event) => void): void {
  listen((event) => {
    if (event.event !== "scene") onEvent(event);
    else if (newer(event.scene as Scene)) say("Changed on another page.");
  });
  let first = true;
  connect(() => {
    void (async () => {
      const reply = await attempt("hello");
      if (!reply) return;
      const known = reply as unknown as Hello;
      hello.value = known;
      take(known.scene);
      if (!first) say("The server is back.");
      first = false;
      await arrive();
    })();
  });
  addEventListener("hashchange", () => void arrive());
}
