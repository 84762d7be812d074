// Instant centres: of the drawing in its pose, of each frame of a drag, and of all samples of a motion in one request.
import { computed, effect, signal } from "@preact/signals";
import { apart, between } from "./geometry";
import type { Centre, Motion, Scene, XY } from "./protocol";
import { attempt, clock, dragged, motion, moving, sampled, scene, showCentres, trial } from "./state";
import { size, view } from "./view";

interface Course {
  links: [string, string];
  at: (XY | null)[];
}

const MOST = 20_000; // largest number of poses in a request; of a longer motion only every nth sample is sent
const RUNS = 0.25; // share of the window; a centre that moves farther between two samples passes through infinity and is not interpolated
const sketched = signal<{ of: Scene; list: Centre[] } | null>(null);
const along = signal<{ of: Motion; times: number[]; list: Course[] } | null>(null);
export const pulled = signal<Centre[] | null>(null); // centres of the present frame of a drag

/** The instant centres of the shown pose; empty until the server has sent them. */
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

/** Requests the centres of the shown drawing or motion, and again if another one is shown meanwhile. */
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
