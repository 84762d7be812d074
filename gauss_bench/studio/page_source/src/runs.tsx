// Jobs of the server: release, comparison with a second engine, and the search for an engine.
import { signal } from "@preact/signals";
import type { JSX } from "preact";
import { useState } from "preact/hooks";
import type { Event, Motion, Pose } from "./protocol";
import { NumberField, hasRefused } from "./fields";
import { Plot } from "./charts";
import { Sheet } from "./sheet";
import { attempt, clock, dialog, ghost, hello, motion, moving, play, playing, say } from "./state";
import { amount, figure, inShown, retold, shownUnit } from "./units";

interface Run {
  engine: string;
  times: number[];
  poses: Record<string, Pose[]>;
  verdict: string;
  reason: string | null;
  trusted_until: number | null;
}
interface Compare {
  engine: string;
  worst_apart: number | null;
  at: number | null;
  point: string | null;
  curve: { times: number[]; apart: (number | null)[] } | null;
}
interface Answer {
  engine: string;
  setting: string;
  ratio: number | null;
  error: number | null;
  status: string;
  message: string | null;
  snippet: string | null;
}

const job = signal<number | null>(null);
const runs = signal<Run[]>([]);
const compared = signal<Compare[]>([]);
const progress = signal("");
const advice = signal<{ job: number | null; answers: Answer[]; done: boolean; note: string }>({ job: null, answers: [], done: true, note: "" });

/** Handles an event of the server. */
export function hear(event: Event): void {
  if (event.event === "singular") {
    if (motion.value && motion.value.job === event.job) motion.value = { ...motion.value, singular: event.singular as Motion["singular"] };
  } else if (event.event === "progress" && (event.job === job.value || event.job === advice.value.job)) progress.value = String(event.text ?? event.note ?? "");
  else if (event.event === "release" && event.job === job.value) {
    const run = event as unknown as Run;
    runs.value = [...runs.value.filter((r) => r.engine !== run.engine), run];
    if (runs.value.length === 1) watch(run);
    else if (run.times?.length) ghost.value = { engine: run.engine, times: run.times, poses: run.poses };
  } else if (event.event === "release_done" && event.job === job.value) {
    compared.value = (event.compared as Compare[] | undefined) ?? (event.compare ? [event.compare as Compare] : []);
    job.value = null;
    progress.value = "";
    if (event.error) say(String(event.error), "error");
  } else if (event.event === "recommend" && event.job === advice.value.job) {
    const more = event.answer as Answer | undefined; // replaces an earlier answer for its engine; the last event has all answers, sorted by cost
    const others = advice.value.answers.filter((a) => a.engine !== more?.engine);
    const answers = (event.answers as Answer[] | undefined) ?? (more ? [...others, more] : others);
    advice.value = { ...advice.value, answers, note: typeof event.advice === "string" ? event.advice : advice.value.note };
  } else if (event.event === "recommend_done" && event.job === advice.value.job) {
    advice.value = { ...advice.value, done: true, note: event.error ? String(event.error) : advice.value.note };
    progress.value = "";
  }
}

/** Shows a released run in place of the driven motion. */
function watch(run: Run): void {
  if (!run.times?.length) return;
  const empty: Motion = { times: run.times, poses: run.poses, points: {}, input: null, singular: [], transmission: [], torque: null, pins: [], advantage: null, limits: null, note: null };
  motion.value = empty;
  clock.value = 0;
  moving.value = true;
  playing.value = false;
  void play();
}

const verdictWord = (run: Run): string => (run.trusted_until !== null && run.trusted_until !== undefined ? `${run.verdict}, trusted to ${figure(run.trusted_until, 3)} s` : run.verdict);

const Engines = ({ of }: { of: { name: string; here: boolean }[] }): JSX.Element => (
  <>
    {of.map((e) => (
      <option key={e.name} value={e.name}>
        {e.name}
        {e.here ? "" : " (not installed)"}
      </option>
    ))}
  </>
);

/** Returns the first of these engines that is installed, else the last one. */
const usable = (...names: string[]): string => names.find((name) => hello.value?.engines.some((e) => e.name === name && e.here)) ?? names.at(-1)!;

export function Release(): JSX.Element {
  const engines = hello.value?.engines ?? [];
  const [until, setUntil] = useState(2);
  const [engine, setEngine] = useState(() => usable("gauss-native", "gauss"));
  const [overlay, setOverlay] = useState(() => usable("mujoco", ""));
  const missing = engines.filter((e) => !e.here && [engine, overlay, "gauss-native", "mujoco"].includes(e.name));
  const go = async (): Promise<void> => {
    if (hasRefused("dialog")) return;
    if (!(until > 0)) return say("The duration must be a positive number of seconds.", "error");
    runs.value = [];
    compared.value = [];
    ghost.value = null;
    const reply = await attempt("release", { until, engine, overlay: overlay ? [overlay] : [] });
    if (!reply) return;
    job.value = Number(reply.job);
  };
  return (
    <Sheet title="Release">
      <p class="note">The linkage starts in the drawn position and moves under gravity, springs and torques. The motion of a second engine can be drawn over it, to see where the two differ and by how much.</p>
      <div class="triple">
        <NumberField label="Until" unit="s" value={until} send={(v) => setUntil(v!)} />
        <label class="field">
          <span>Engine</span>
          <select aria-label="Engine" value={engine} onChange={(e) => setEngine(e.currentTarget.value)}>
            <Engines of={engines.length ? engines : [{ name: "gauss-native", here: true }]} />
          </select>
        </label>
        <label class="field">
          <span>Laid over it</span>
          <select aria-label="Laid over it" value={overlay} onChange={(e) => setOverlay(e.currentTarget.value)}>
            <option value="">nothing</option>
            <Engines of={engines} />
          </select>
        </label>
      </div>
      {missing.map((e) => (
        <p key={e.name} class={e.name === engine || e.name === overlay ? "refusal" : "note"}>{`${e.name}: ${e.reason || "not installed"}`}</p>
      ))}
      <div class="row">
        <button type="button" class="strong" disabled={job.value !== null} onClick={() => void go()}>
          Let it go
        </button>
        {job.value !== null && (
          <button type="button" class="quiet" onClick={() => void attempt("stop", { job: job.value })}>
            Stop
          </button>
        )}
        <button type="button" class="quiet" onClick={() => (dialog.value = "recommend")}>
          Which engine should I take?
        </button>
      </div>
      {job.value !== null && <p class="note" role="status">Running … {progress.value}</p>}
      <ul class="verdicts" aria-live="polite">
        {runs.value.map((run) => (
          <li key={run.engine}>
            <b>{run.engine}</b> <span class={`verdict ${/^(ok|trusted|accurate)/.test(run.verdict) ? "good" : "doubtful"}`}>{verdictWord(run)}</span>
            {run.reason && <small>{retold(run.reason)}</small>}
          </li>
        ))}
        {compared.value.map((c) => (
          <li key={`apart ${c.engine}`}>
            <b>{c.engine}</b> parts by at most <b>{amount(c.worst_apart, "m", 3)}</b>
            {c.point ? ` at ${c.point}` : ""}, {figure(c.at, 3)} s after the start.
            {c.curve && <Apart curve={c.curve} />}
          </li>
        ))}
      </ul>
      {runs.value.length > 0 && (
        <div class="row">
          <button type="button" class="quiet" onClick={() => (dialog.value = "")}>
            Watch it
          </button>
        </div>
      )}
    </Sheet>
  );
}

/** The distance of two runs over time, on a logarithmic scale. */
function Apart({ curve }: { curve: NonNullable<Compare["curve"]> }): JSX.Element {
  const [at, go] = useState(0);
  const [under, look] = useState<number | null>(null);
  const chart = { id: "apart", title: "Apart", unit: shownUnit("m"), log: true, curves: [{ name: "apart", hue: 1, values: curve.apart.map((v) => (v === null ? null : inShown(v, "m"))) }] };
  return <Plot chart={chart} times={curve.times} at={under ?? at} look={look} go={go} />;
}

export function Recommend(): JSX.Element {
  const [position, setPosition] = useState(1e-5);
  const [budget, setBudget] = useState(30);
  const [only, setOnly] = useState("");
  const [copied, setCopied] = useState("");
  const now = advice.value;
  const go = async (): Promise<void> => {
    if (hasRefused("dialog")) return;
    advice.value = { job: null, answers: [], done: false, note: "" };
    const reply = await attempt("recommend", { position, budget, engines: only ? [only] : [] });
    if (reply) advice.value = { ...advice.value, job: Number(reply.job) };
    else advice.value = { ...advice.value, done: true };
  };
  return (
    <Sheet title="Which engine, with which setting">
      <p class="note">The search runs engines on this linkage and compares them with a certified reference; the cheapest setting with the required accuracy comes first.</p>
      <div class="triple even">
        <NumberField label="Position to within" unit="m" value={position} send={(v) => setPosition(v!)} />
        <NumberField label="In at most" unit="s" value={budget} send={(v) => setBudget(v!)} />
        <label class="field">
          <span>Of</span>
          <select aria-label="Of which engines" value={only} onChange={(e) => setOnly(e.currentTarget.value)}>
            <option value="">all engines</option>
            <Engines of={(hello.value?.engines ?? []).filter((e) => e.here)} />
          </select>
        </label>
      </div>
      <div class="row">
        <button type="button" class="strong" disabled={!now.done} onClick={() => void go()}>
          Recommend
        </button>
        {!now.done && now.job !== null && (
          <button type="button" class="quiet" onClick={() => void attempt("stop", { job: now.job })}>
            Stop
          </button>
        )}
      </div>
      {!now.done && <p class="note" role="status">Measuring … {retold(progress.value || now.note)}</p>}
      {now.done && now.note && <p class="note">{retold(now.note)}</p>}
      <ol class="answers" aria-live="polite">
        {now.answers.filter((a) => a.status === "ok").map((a) => (
          <li key={a.engine}>
            <b>{a.engine}</b> <span>{a.setting}</span>
            <small>
              {a.ratio !== null && a.ratio !== undefined ? `${a.ratio <= 1 ? "the fastest" : `${figure(a.ratio, 3)} times as long as the fastest`}, ` : now.done ? "" : "holds; not timed yet, "}
              error {amount(a.error, "m", 2)}
            </small>
            {a.snippet && (
              <>
                <pre tabIndex={0}>{a.snippet}</pre>
                <button
                  type="button"
                  class="quiet"
                  onClick={() => {
                    void navigator.clipboard?.writeText(a.snippet!).then(() => setCopied(a.engine));
                  }}
                >
                  {copied === a.engine ? "Copied" : "Copy"}
                </button>
              </>
            )}
          </li>
        ))}
      </ol>
      {now.done && now.answers.some((a) => a.status !== "ok") && (
        <details class="fallen">
          <summary>Engines that miss this accuracy, and why</summary>
          <ul>
            {now.answers.filter((a) => a.status !== "ok").map((a) => (
              <li key={a.engine}>
                <b>{a.engine}</b> <small>{retold(a.message || a.status)}</small>
              </li>
            ))}
          </ul>
        </details>
      )}
    </Sheet>
  );
}
