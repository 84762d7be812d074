// Curves over time: axes with ticks, a cursor that shows values, and the table of all curves.
import type { JSX } from "preact";
import { useMemo, useRef } from "preact/hooks";
import type { Motion, XY } from "./protocol";
import { sampled } from "./state";
import { figure, inShown, shownUnit } from "./units";

type Values = (number | null)[];
interface Curve {
  name: string;
  hue: number;
  values: Values;
}
export interface Chart {
  id: string;
  title: string;
  unit: string; // the shown unit
  log?: boolean; // whether the scale is logarithmic
  curves: Curve[];
}

const FLAT = 1e-9; // relative to its size: a curve that changes by less is drawn as constant
const SHOWN = 6; // largest number of curves in a chart, which is the number of colours

const lengths = (list: ([number | null, number | null] | number | null)[] | null): Values =>
  (list ?? []).map((v) => (typeof v === "number" ? v : v && v[0] !== null && v[1] !== null ? Math.hypot(v[0], v[1]) : null));
const isKnown = (v: number | null): v is number => v !== null && Number.isFinite(v);

/** Returns the charts of all curves of a motion, in the shown units. */
export function charts(now: Motion): Chart[] {
  const points = Object.entries(now.points);
  const chart = (id: string, title: string, unit: string, curves: Curve[]): Chart => ({
    id,
    title,
    unit: shownUnit(unit),
    curves: curves.map((c) => ({ ...c, values: c.values.map((v) => (v === null ? null : inShown(v, unit))) })),
  });
  return [
    chart("v", "Speed", "m/s", points.map(([name, p], hue) => ({ name, hue, values: lengths(p.v) }))),
    chart("a", "Acceleration", "m/s²", points.map(([name, p], hue) => ({ name, hue, values: lengths(p.a) }))),
    chart("torque", now.torque?.unit === "N" ? "Drive force" : "Drive torque", now.torque?.unit ?? "N m", now.torque ? [{ name: "drive", hue: 1, values: now.torque.values }] : []),
    chart("transmission", "Transmission angle", "°", now.transmission.map((t, hue) => ({ ...t, hue }))),
    chart("pins", "Pin forces", "N", now.pins.map((p, hue) => ({ name: p.joint, hue, values: lengths(p.force) }))),
    chart("advantage", "Mechanical advantage", "", (now.advantage ?? []).map((g, hue) => ({ name: `${g.output} of ${g.input}`, values: g.values, hue }))),
  ].filter((c) => c.curves.some((curve) => curve.values.some(isKnown)));
}

const cell = (text: string): string => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

/** Returns the table of a motion as CSV: time, input, places of the observed points, and every curve of every chart. */
export function csv(now: Motion, list: Chart[]): string {
  const place = (i: 0 | 1, p: XY[]): Values => p.map((at) => inShown(at[i], "m"));
  const turns = now.input?.unit === "rad";
  const columns: [string, Values][] = [
    ["time [s]", now.times],
    ...(now.input ? [[`input ${now.input.name} [${turns ? "deg" : shownUnit("m")}]`, now.input.values.map((v) => v === null ? null : turns ? (v * 180) / Math.PI : inShown(v, "m"))] as [string, Values]] : []),
    ...Object.entries(now.points).flatMap(([name, { p }]) => ([0, 1] as const).map((i): [string, Values] => [`${"xy"[i]} ${name} [${shownUnit("m")}]`, place(i, p)])),
    ...list.flatMap((c) => c.curves.map((curve): [string, Values] => [`${c.title.toLowerCase()} ${curve.name} [${c.unit === "°" ? "deg" : c.unit || "1"}]`, curve.values])),
  ];
  const rows = now.times.map((_, i) => columns.map(([, values]) => (isKnown(values[i] ?? null) ? String(values[i]) : "")).join(","));
  return [columns.map(([head]) => cell(head)).join(","), ...rows, ""].join("\n");
}

/** Returns the range of the vertical axis: the 2nd to the 98th percentile and a margin, which cut large values near singular positions.
 *  A curve that changes only by rounding gets a range from zero. */
function bounds(curves: Curve[]): [number, number] {
  const all = curves.flatMap((c) => c.values.filter(isKnown)).sort((a, b) => a - b);
  const at = (share: number): number => all[Math.round(share * (all.length - 1))] ?? 0;
  const [low, high] = [at(0), at(1)];
  const [inner, outer] = [at(0.02), at(0.98)];
  const wide = (outer - inner) * 2 + 1e-12;
  const from = low < inner - wide ? inner - wide / 4 : low;
  const to = high > outer + wide ? outer + wide / 4 : high;
  const gap = to - from;
  if (gap <= FLAT * Math.max(Math.abs(from), Math.abs(to))) return [Math.min(0, 1.2 * from), Math.max(0, 1.2 * to) || (from < 0 ? 0 : 1)];
  return [Math.min(from, from > 0 && from < gap ? 0 : from), to + 0.06 * gap];
}

/** Returns round numbers from `low` to `high`, about `most` of them at most, with distances of 1, 2 or 5 times a power of ten. */
function ticks(low: number, high: number, most: number, least = 0): number[] {
  const wanted = Math.max((high - low) / most, least, 1e-300);
  const power = 10 ** Math.floor(Math.log10(wanted));
  const step = ([1, 2, 5].find((f) => f * power >= wanted * (1 - 1e-9)) ?? 10) * power;
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.min(Math.max(count, 0), 2 * most + 2) }, (_, k) => Number(((first + k) * step).toPrecision(12)));
}

/** Returns a round number with all of its digits, so that no two ticks have the same label. */
const mark = (v: number): string => (v !== 0 && (Math.abs(v) >= 1e5 || Math.abs(v) < 1e-4) ? v.toExponential() : String(v));

/** Returns the value at a time by linear interpolation; null if one of the two samples is missing. */
function valueAt(values: Values, times: number[], at: number): number | null {
  const [i, share] = sampled(times, at);
  const a = values[i] ?? null;
  const b = values[i + 1] ?? a;
  return isKnown(a) && isKnown(b) ? a + share * (b - a) : share < 0.5 ? a : b;
}

interface Plotted {
  chart: Chart;
  times: number[];
  at: number; // time of the cursor [s]
  look: (at: number | null) => void; // called with the time under the mouse, or null when it leaves
  go: (at: number) => void; // called with the time that a click, a drag or a key chooses
}

/** One chart. The plot is a slider: arrow keys move its cursor from sample to sample, and a finger or a pressed mouse drags it. */
export function Plot({ chart, times, at, look, go }: Plotted): JSX.Element {
  const end = times.at(-1) || 1;
  const curves = useMemo(() => chart.curves.slice(0, SHOWN), [chart.curves]);
  const drawn = useMemo(() => {
    const scaled = chart.log ? curves.map((c) => ({ ...c, values: c.values.map((v) => (isKnown(v) && v > 0 ? Math.log10(v) : null)) })) : curves;
    const [low, high] = bounds(scaled);
    const y = (v: number): number => Math.max(-4, Math.min(104, 100 - ((v - low) / (high - low || 1)) * 100));
    const line = (values: Values): string => {
      let d = "";
      let gap = true;
      values.forEach((v, i) => {
        if (isKnown(v)) d += `${gap ? "M" : "L"}${((times[i]! / end) * 100).toFixed(2)} ${y(v).toFixed(2)}`;
        gap = !isKnown(v);
      });
      return d;
    };
    const marks = ticks(low, high, 5, chart.log ? 1 : 0).map((v) => ({ y: y(v), text: chart.log ? `1e${v}` : mark(v) }));
    return { marks, zero: !chart.log && low < 0 && high > 0 ? y(0) : null, lines: scaled.map((c) => line(c.values)), scaled, y };
  }, [curves, times, chart.log]);
  const xs = useMemo(() => ticks(0, end, 4), [end]);
  const box = useRef<HTMLDivElement>(null);
  const under = (e: PointerEvent): number => {
    const { left, width } = box.current!.getBoundingClientRect();
    return Math.max(0, Math.min(end, ((e.clientX - left) / width) * end));
  };
  const key = (e: KeyboardEvent): void => {
    const sample = end / Math.max(times.length - 1, 1);
    const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10, Home: -Infinity, End: Infinity }[e.key];
    if (by === undefined || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    look(null);
    go(Math.max(0, Math.min(end, at + by * (e.shiftKey ? 10 : 1) * sample)));
  };
  const values = curves.map((c) => valueAt(c.values, times, at));
  const read = curves.map((c, k) => `${c.name} ${figure(values[k])}${chart.unit && ` ${chart.unit}`}`).join(", ");
  return (
    <figure class="chart" data-chart={chart.id}>
      <figcaption>
        {chart.title} {chart.unit && <small>{chart.unit}</small>}
        <output>{figure(at, 3)} s</output>
      </figcaption>
      <div class="plot">
        <div class="scale" aria-hidden="true">
          {drawn.marks.map(({ y, text }) => (
            <span key={text} style={{ top: `${y}%` }}>
              {text}
            </span>
          ))}
        </div>
        <div
          ref={box}
          class="area"
          role="slider"
          tabIndex={0}
          aria-label={`Cursor of ${chart.title}`}
          aria-valuemin={0}
          aria-valuemax={end}
          aria-valuenow={at}
          aria-valuetext={`${figure(at, 3)} s: ${read}`}
          onKeyDown={key}
          onPointerDown={(e) => {
            if (e.button !== 0) return;
            e.currentTarget.setPointerCapture(e.pointerId);
            look(null);
            go(under(e));
          }}
          onPointerMove={(e) => (e.buttons ? go(under(e)) : e.pointerType === "mouse" && look(under(e)))}
          onPointerLeave={() => look(null)}
        >
          <svg viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden="true">
            <path class="ticks" d={drawn.marks.map(({ y }) => `M0 ${y}H100`).join("") + xs.map((t) => `M${(t / end) * 100} 0V100`).join("")} />
            {drawn.zero !== null && <path class="zero" d={`M0 ${drawn.zero}H100`} />}
            {curves.map((c, k) => <path key={c.name} class={`curve-${c.hue % 6}`} d={drawn.lines[k]} />)}
            {drawn.scaled.map((c) => {
              const v = valueAt(c.values, times, at);
              return isKnown(v) && <path key={c.name} class={`spot curve-${c.hue % 6}`} d={`M${(at / end) * 100} ${drawn.y(v)}h0`} />;
            })}
            <path class="now" d={`M${(Math.min(at, end) / end) * 100} 0V100`} />
          </svg>
        </div>
        <div class="scale along" aria-hidden="true">
          {xs.map((t, k) => (
            <span key={t} style={{ left: `${(t / end) * 100}%` }}>
              {figure(t)}
              {k === xs.length - 1 && " s"}
            </span>
          ))}
        </div>
      </div>
      <ul>
        {curves.map((c, k) => (
          <li key={c.name} class={`curve-${c.hue % 6}`}>
            {c.name} <b>{figure(values[k])}</b>
          </li>
        ))}
        {chart.curves.length > SHOWN && <li class="more">{chart.curves.length - SHOWN} more in the table</li>}
      </ul>
    </figure>
  );
}
