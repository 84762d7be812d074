// What the page knows: the scene, what is chosen, what is shown over it. Every change of the linkage goes through `edit`.
import { batch, computed, signal } from "@preact/signals";
import { Placed } from "./geometry";
import type { Event, Hello, Motion, Pose, Poses, Reply, Scene, XY } from "./protocol";
import { Refused, ask, connect, listen } from "./socket";
import { fit, view, within } from "./view";

export type Picked = { kind: "link" | "pin" | "slide" | "force"; id: string };

export const hello = signal<Hello | null>(null);
export const scene = signal<Scene | null>(null);
export const selection = signal<Picked[]>([]);
export const said = signal<{ text: string; level: "error" | "notice" | "info"; field?: string } | null>(null); // the line that is read aloud
export const dialog = signal<"" | "gallery" | "open" | "share" | "release" | "recommend" | "help" | "export" | "save" | "branches">("");
export const sheet = signal<"" | "properties" | "curves">(""); // narrow screens: which panel covers the drawing
export const touring = signal(-1);

// Over the scene
export const dragged = signal<Poses | null>(null);
export const trial = signal<Scene | null>(null); // the drawing as it would be, while a pin is put elsewhere
export const drawn = computed(() => trial.value ?? scene.value);
export const behind = signal<{ id: string; url: string } | null>(null); // the picture of the scene
export const motion = signal<Motion | null>(null);
export const moving = signal(false); // the motion is shown rather than the sketch
export const playing = signal(false);
export const clock = signal(0); // seconds of the motion
export const pace = signal(1);
export const ghost = signal<{ engine: string; times: number[]; poses: Record<string, [number, number, number][]> } | null>(null);
export const showCentres = signal(false);
export const lined = signal(true); // a grid that pulls
export const frames = signal({ solved: 0, ms: 0, jump: 0 });

const FLIES = 4; // times the window that shows the sketch
let fitting = false;
let fitted = -Infinity; // when the motion was last fitted into the window

/** Whether the curves of a motion that was just fitted may be taking their room. */
export const settling = (): boolean => performance.now() - fitted < 500;

/** Where every pin goes in the motion, one place in eight. */
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

/** The whole linkage in the window, and its motion too, once that is there. */
export function show(): void {
  fit(scene.value, swept());
  fitting = motion.value === null && (scene.value?.links.length ?? 0) > 0;
}

/** Whether the sketch is in the window as a whole. */
export const inView = (): boolean => within(scene.value);

/** Shows the whole of the motion, where it leaves the window; one that flies off is let go. */
export function follow(): void {
  const before = view.value;
  if (within(scene.value, swept())) return;
  show();
  if (view.value.scale < before.scale / FLIES) view.value = before;
}

/** The sample before an instant, and which share of the way to the next one has passed. */
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

/** The poses on show: of the drag, else of the motion, else the scene's own. */
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

/** Says a sentence in the status line, which screen readers read aloud; mere information goes by itself. */
export function say(text: string, level: "error" | "notice" | "info" = "info"): void {
  const word = { text, level };
  said.value = word;
  if (level === "info") setTimeout(() => said.value === word && (said.value = null), 6000);
}

/** Runs a request and says its refusal instead of throwing it. */
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

/** Asks for the picture that a scene names, unless it is here. */
async function look(id: string | null): Promise<void> {
  if (id === (behind.value?.id ?? null)) return;
  behind.value = null;
  const reply = id && (await attempt("behind"));
  if (reply && reply.picture === scene.value?.picture?.id) behind.value = { id, url: String(reply.url) };
}

/** Whether what is drawn may be left: it is saved, or whoever drew it says so. */
const leaving = (): boolean =>
  !scene.value?.unsaved || !scene.value.links.length || confirm(`${scene.value.name} has changes that are not saved. Leave them?`);

/** Another linkage is open: its motion is not here yet, and it is shown as a whole. */
export function anew(): void {
  motion.value = null;
  selection.value = [];
  clock.value = 0;
  show();
}

/** Opens something else, if what is drawn may be left; the reply, or null where it stays as it is. */
export async function open(what: object, verb = "open"): Promise<Reply | null> {
  const reply = leaving() ? await edit(verb, what) : null;
  if (reply) anew();
  return reply;
}

/** Opens the linkage that the address carries, which is taken out of it. */
async function arrive(): Promise<void> {
  const fragment = location.hash.slice(1);
  if (!fragment) return;
  history.replaceState(null, "", location.pathname + location.search);
  await open({ fragment });
}

/** Takes up what was drawn before and lost with the server, or lets it go. */
export async function recover(take: boolean): Promise<void> {
  if (!(await edit("recover", { take }))) return;
  hello.value = { ...hello.value!, recovered: null }; // it is offered once
  if (take) anew();
}

/** One edit of the linkage; the new scene is shown. Returns the reply, or null where the server refused with a reason. */
export async function edit(verb: string, what: object = {}): Promise<Reply | null> {
  fitting = false; // who draws keeps his window
  const reply = await attempt(verb, what);
  if (reply?.scene) newer(reply.scene);
  if (reply && "recovered" in reply) hello.value = { ...hello.value!, recovered: reply.recovered as Hello["recovered"] };
  return reply;
}

/** Shows a scene, unless another page's, which came before it, is newer. */
function newer(next: Scene): boolean {
  if (next.revision < (scene.value?.revision ?? 0)) return false;
  take(next);
  return true;
}

// The motion follows the linkage by itself, a moment after the last edit.
let later: ReturnType<typeof setTimeout> | undefined;
let wanted = 0;
export const motionNote = signal("");

const OPEN = "The linkage does not assemble and cannot move: see the problems.";
const FAST = "Nothing can move: there is no degree of freedom. Delete a link, or release a pin from the ground.";
const LOOSE = "Nothing can be driven yet: pin a link to the ground.";

/** Computes the driven motion of the scene anew, a moment from now. */
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
    if (fitting && !dragged.value) { // whoever has begun to pull keeps the window under the pointer
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

/** The motion of now, computed if it is not there yet. */
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
  if (began && inView()) follow(); // who looks at a part of it goes on doing so
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

/** Back to the sketch, which is what is edited. */
export function still(): void {
  batch(() => {
    playing.value = false;
    moving.value = false;
  });
}

// A copy of the text in the page: what can be saved from here when the server has gone.
let keeping: ReturnType<typeof setTimeout> | undefined;
export const copy = signal("");

function keep(): void {
  clearTimeout(keeping);
  keeping = setTimeout(async () => {
    const reply = await ask("text").catch(() => null); // a copy is a courtesy: the server keeps one itself
    if (reply) copy.value = String(reply.text ?? "");
  }, 300);
}

/** Greets the server after every opening of the socket. */
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
