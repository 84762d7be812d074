// Instant centres of what is on show: of a sketch where it is drawn, of a drag with each of its frames, of a motion all along it at once.
import { computed, effect, signal } from "@preact/signals";
import { apart, between } from "./geometry";
import type { Centre, Motion, Scene, XY } from "./protocol";
import { attempt, clock, dragged, motion, moving, sampled, scene, showCentres, trial } from "./state";
import { size, view } from "./view";

interface Course {
  links: [string, string];
  at: (XY | null)[];
}

const MOST = 20_000; // poses of a request: longer motions are sent thinned out
const RUNS = 0.25; // of the window, from one sample to the next: a centre that runs off to infinity and comes back from the other side
const sketched = signal<{ of: Scene; list: Centre[] } | null>(null);
const along = signal<{ of: Motion; times: number[]; list: Course[] } | null>(null);
export const pulled = signal<Centre[] | null>(null); // of the frame of a drag on show

/** Those of the frame on show; none until they are known. */
export const centres = computed<Centre[]>(() => {
  if (!showCentres.value || trial.value) return [];
  if (dragged.value) return pulled.value ?? [];
  if (!moving.value) return sketched.value?.of === scene.value ? (sketched.value?.list ?? []) : [];
  const course = along.value;
  if (!course || course.of !== motion.value) return [];
  const [i, share] = sampled(course.times, clock.value);
  const far = (RUNS * Math.max(...size.value)) / view.value.scale;
  return course.list.map(({ links, at }) => {
    const [a, b] = [at[i] ?? null, at[i + 1] ?? at[i] ?? null];
    const near = share < 0.5 ? a : b;
    return { links, at: a && b && apart(a, b) < far ? between(a, b, share) : near };
  });
});

let asking = false;
let again = false;

/** Asks for what is on show, and once more if that has become another meanwhile. */
async function find(): Promise<void> {
  again = asking;
  if (asking) return;
  asking = true;
  do {
    again = false;
    const [drawing, course] = [scene.value, moving.value ? motion.value : null];
    if (!drawing || !showCentres.value) break;
    if ((course ? along.value?.of : sketched.value?.of) === (course ?? drawing)) break;
    const every = course ? Math.ceil((course.times.length * drawing.links.length) / MOST) : 1;
    const thin = <T>(list: T[]): T[] => list.filter((_, k) => k % every === 0);
    const poses = course && Object.fromEntries(Object.entries(course.poses).map(([name, list]) => [name, thin(list)]));
    const reply = await attempt("centres", poses ? { along: poses } : {});
    if (!reply) showCentres.value = false;
    else if (course) along.value = { of: course, times: thin(course.times), list: reply.centres as Course[] };
    else sketched.value = { of: drawing, list: reply.centres as Centre[] };
  } while (again);
  asking = false;
}

effect(() => {
  const wanted = showCentres.value && scene.value && !dragged.value && (!moving.value || motion.value);
  if (wanted) void find();
});
