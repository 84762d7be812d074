// The tool Poses: the user places three poses of a coupler, and the server computes a four-bar that passes through them.
import { effect, signal } from "@preact/signals";
import type { JSX } from "preact";
import { useState } from "preact/hooks";
import { apart, between, direction } from "./geometry";
import type { XY } from "./protocol";
import { edit } from "./state";
import { Refused, ask } from "./socket";
import { choose, picks, posed, tool } from "./tools";
import { retold } from "./units";
import { toScreen } from "./view";

interface FourBar {
  connections: { places: XY[]; pivot: XY; slide_deg: number | null }[];
  drives: { fault: string; text: string; travel: number }[];
}

const NARROW = 760; // [pixels] in a narrower window the sentences are folded, so that they do not cover the drawing
const POSES = 6; // number of picks: two places of the coupler in each of three poses
const found = signal<FourBar | null>(null);
const refusal = signal("");

/** Returns the places of the finished picks, or else those of the present picks. */
const places = (): XY[] => posed.value ?? picks.value.map((p) => p.at);

/** Returns pairs of places of the coupler. Its length is that of the first pair; later pairs give only its direction. */
function bars(): [XY, XY][] {
  const given = places();
  const length = given[1] ? apart(given[0]!, given[1]) : 0;
  return [0, 2, 4].flatMap((k) => {
    const [a, b] = [given[k], given[k + 1]];
    return a && b && k + 1 < POSES ? [[a, between(a, b, length / Math.max(apart(a, b), 1e-12))] as [XY, XY]] : [];
  });
}

/** Returns the request for the four-bar; null until there are three poses, and while the second of two pivots is missing. */
function request(): object | null {
  const given = places();
  if (tool.value !== "poses" || given.length < POSES || given.length === POSES + 1) return null;
  const poses = bars().map(([a, b]) => [...a, (direction(a, b) * 180) / Math.PI]);
  return given.length > POSES ? { poses, pivots: given.slice(POSES) } : { poses, pins: given.slice(0, 2) };
}

let asked = 0;
effect(() => {
  const what = request();
  const mine = ++asked;
  found.value = null;
  refusal.value = "";
  if (!what) return;
  ask("four_bar", what).then(
    (reply) => mine === asked && (found.value = reply as unknown as FourBar),
    (error: unknown) => mine === asked && (refusal.value = error instanceof Refused ? error.fault.text : String(error)),
  );
});

/** Returns a sentence on the motion by the better of the two drives. */
const verdict = ({ drives }: FourBar): string =>
  drives.some((d) => !d.fault)
    ? "It passes through the poses in their order, on one branch."
    : drives.some((d) => d.fault === "order")
      ? "It passes through the poses in another order."
      : "It cannot move from pose to pose.";

/** Draws the four-bar; with `drive`, also drives the connection that moves it through the poses. One undo removes both. */
async function draw(drive: boolean): Promise<void> {
  const [what, now] = [request(), found.value];
  if (!what || !now) return;
  const reply = await edit("synthesize", what);
  if (!reply) return;
  const parts = ((reply.made ?? []) as string[]).filter((id) => /^(links|slides)\./.test(id) && !id.startsWith("links.block")).reverse();
  const driven = now.drives.findIndex((d) => !d.fault);
  const part = parts[driven + 1]; // parts[0] is the coupler
  if (drive && driven >= 0 && part) {
    const { travel } = now.drives[driven]!; // a bar turns without end; a slide moves to the third pose
    const law = part.startsWith("links.") ? { law: "constant", speed: Math.sign(travel) * 2 * Math.PI } : { law: "sine", travel, time: 1 };
    await edit("drive", { coordinate: part.slice(part.indexOf(".") + 1), ...law, continues: true });
  }
  choose("select");
}

/** The panel beside the drawing with the result of the search. */
export function PosesBar(): JSX.Element | null {
  const [drive, setDrive] = useState(true);
  if (tool.value !== "poses" || places().length < POSES) return null;
  const now = found.value;
  const free = now && !now.drives.some((d) => !d.fault);
  const slides = now?.connections.filter((c) => c.slide_deg !== null).length ?? 0;
  return (
    <div class="picturebar posesbar" role="region" aria-label="Four-bar through three poses">
      {refusal.value && <p class="refusal" role="alert">There is no such four-bar: {retold(refusal.value)}.</p>}
      {now && (
        <details open={innerWidth > NARROW}>
          <summary class={free ? "doubtful" : "good"}>{verdict(now)}</summary>
          <ul>
            {slides > 0 && <li>{slides === 1 ? "One pin goes along a line: it becomes a slide." : "Both pins go along lines: they become slides."}</li>}
            {now.drives.map((d) => <li key={d.text} class={d.fault ? "doubtful" : "good"}>{d.text}</li>)}
          </ul>
        </details>
      )}
      {!posed.value && places().length === POSES && <p class="note">Click two fixed pivots to get other pins of the coupler instead.</p>}
      {places().length === POSES + 1 && <p class="note">Click the second fixed pivot.</p>}
      <div class="row">
        {now && (
          <button type="button" class="strong" onClick={() => void draw(drive && !free)}>
            Make it the sketch
          </button>
        )}
        {now && !free && (
          <label>
            <input type="checkbox" checked={drive} onChange={(e) => setDrive(e.currentTarget.checked)} /> and drive it
          </label>
        )}
        <button type="button" class="quiet" onClick={() => choose("poses")}>
          Place anew
        </button>
      </div>
    </div>
  );
}

/** The poses, the circles or lines of the pins, and the fixed pivots. */
export function Poses(): JSX.Element | null {
  if (tool.value !== "poses") return null;
  const line = ([a, b]: [XY, XY]): string => `M${toScreen(a).join(" ")}L${toScreen(b).join(" ")}`;
  return (
    <g class="poses" aria-hidden="true">
      {found.value?.connections.map(({ places: at, pivot, slide_deg }, i) => {
        const radius = apart(toScreen(pivot), toScreen(at[0]!));
        const [x, y] = toScreen(pivot);
        return (
          <g key={i} data-pivot={pivot.join()}>
            {slide_deg === null ? <circle class="way" cx={x} cy={y} r={radius} /> : <path class="way" d={at.map((p, k) => `${k ? "L" : "M"}${toScreen(p).join(" ")}`).join("")} />}
            {slide_deg === null && <path class="bar" d={line([pivot, at[0]!])} />}
            {slide_deg === null && <path class="foot" d={`M${x} ${y}l-10 17h20z`} />}
            {at.map((p, k) => <circle key={k} class="pin" cx={toScreen(p)[0]} cy={toScreen(p)[1]} r="4" />)}
          </g>
        );
      })}
      {bars().map((bar, k) => {
        const [x, y] = toScreen(bar[0]);
        return (
          <g key={k}>
            <path class="pose" d={line(bar)} />
            <text x={x - 8} y={y - 10} text-anchor="end">
              {k + 1}
            </text>
          </g>
        );
      })}
      {places().slice(POSES).map((p, k) => <circle key={k} class="placed" cx={toScreen(p)[0]} cy={toScreen(p)[1]} r="6" />)}
    </g>
  );
}
