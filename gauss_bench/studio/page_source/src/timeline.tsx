// The panel below the drawing: play, time slider, speed, drivers of the motion, and curves.
import { computed, signal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Plot, charts, csv } from "./charts";
import { download } from "./download";
import { NumberField } from "./fields";
import { Sign } from "./icons";
import type { Driver as DriverKind, Motion, Table } from "./protocol";
import { choose } from "./tools";
import { clock, dialog, edit, ghost, motion, motionNote, moving, pace, play, playing, refresh, scene, scrub, sheet, showCentres, still } from "./state";
import { amount, figure, retold } from "./units";

const open = signal(innerWidth > 560);
const off = signal<Set<string>>(new Set(["pins", "advantage"]));
const under = signal<number | null>(null); // time under the mouse in a chart [s]
const curves = computed(() => (motion.value ? charts(motion.value) : []));

/** Offers the table of all curves as a download, also of those that are not shown. */
function downloadTable(): void {
  const now = motion.value;
  if (now) download(`${scene.value?.name || "linkage"}_curves.csv`, csv(now, curves.value), "text/csv");
}

const LAWS: [string, string][] = [["constant", "constant speed"], ["sine", "cycloidal, rest to rest"], ["cosine", "harmonic"], ["poly345", "3-4-5 polynomial"]];

/** The drivers of the scenario "driven" with their laws. Each change is an edit. */
function Drive(): JSX.Element | null {
  const ref = useRef<HTMLDetailsElement>(null);
  useEffect(() => {
    const leave = (e: PointerEvent): void => {
      if (ref.current?.open && !ref.current.contains(e.target as Node)) ref.current.open = false;
    };
    addEventListener("pointerdown", leave, true);
    return () => removeEventListener("pointerdown", leave, true);
  }, []);
  const away = (e: KeyboardEvent): void => {
    if (e.key !== "Escape" || !ref.current?.open) return;
    e.stopPropagation();
    ref.current.open = false;
    ref.current.querySelector("summary")?.focus();
  };
  const now = scene.value;
  if (!now) return null;
  const scenario = now.scenarios.find((s) => s.name === "driven" && s.kind === "driven") ?? now.scenarios.find((s) => s.kind === "driven");
  const table = (scenario?.table ?? {}) as { driver?: Table; drivers?: Table[]; duration?: number };
  const drivers = table.drivers ?? (table.driver ? [table.driver] : []);
  if (!now.drivers_possible.length && !drivers.length) return null;
  const named = drivers.map(nameOf).filter(Boolean);
  const free = now.drivers_possible.filter((d) => !named.includes(d.name));
  const more = drivers.length === 0 || drivers.length < (now.status.dof ?? 0);
  return (
    <details ref={ref} class="drive" onKeyDown={away}>
      <summary title="The driven coordinates and their motion laws">{named.length ? `Drives ${named.join(", ")}` : "Driver"}</summary>
      <div class="pop">
        {drivers.map((driver) => (
          <OneDriver key={nameOf(driver)} driver={driver} free={free} duration={table.duration ?? 1} />
        ))}
        {more && free.length > 0 && (
          <label class="field">
            <span>{drivers.length ? "And drive" : "Drive"}</span>
            <select value="" onChange={(e) => void begin(e.currentTarget.value)} aria-label="Driven coordinate">
              <option value="">choose …</option>
              {free.map(option)}
            </select>
          </label>
        )}
        {drivers.length > 0 && (
          <NumberField label="Duration" unit="s" value={table.duration ?? null} send={(duration) => edit("drive", { ...lawOf(drivers[0]!), coordinate: nameOf(drivers[0]!), duration })} />
        )}
      </div>
    </details>
  );
}

const nameOf = (driver: Table): string => String(driver.link ?? driver.joint ?? (Array.isArray(driver.between) ? driver.between.join(" to ") : ""));
const option = (d: { name: string; kind: string }): JSX.Element => (
  <option key={d.name} value={d.name}>
    {d.name} ({d.kind})
  </option>
);

/** Returns the law of a driver: its table without the keys that name the coordinate. */
function lawOf(driver: Table): Table {
  const { link: _link, joint: _joint, between: _between, ...law } = driver;
  return law;
}

/** Drives a coordinate from its value in the drawing by the default law of its kind. */
const begin = (name: string): Promise<unknown> => edit("drive", { coordinate: name });

function OneDriver({ driver, free, duration }: { driver: Table; free: DriverKind[]; duration: number }): JSX.Element {
  const name = nameOf(driver);
  const kind = scene.value!.drivers_possible.find((d) => d.name === name)?.kind ?? (driver.link ? "angle" : "slide");
  const angle = kind === "angle";
  const law = String(driver.law ?? "constant");
  const value = (key: string): number | null => (typeof driver[key] === "number" ? (driver[key] as number) : null);
  const coordinate = Array.isArray(driver.between) ? { between: driver.between } : name;
  const drive = (change: Table): unknown => edit("drive", { ...lawOf(driver), coordinate, duration, ...change });
  const rate = value("speed");
  const start = angle ? (value("start_deg") ?? ((value("start") ?? 0) * 180) / Math.PI) : (value("start") ?? 0);
  const another = async (next: string): Promise<void> => {
    await edit("drive", { coordinate, off: true });
    if (next) await begin(next);
  };
  const byLaw = (next: string): unknown => {
    const { speed: _speed, travel: _travel, travel_deg: _degrees, time: _time, rows: _rows, ...rest } = lawOf(driver);
    const rise = angle ? { travel_deg: value("travel_deg") ?? 360 } : { travel: value("travel") ?? 0.05 };
    const numbers = next === "constant" ? { speed: angle ? 2 * Math.PI : 0.05 } : { ...rise, time: value("time") ?? 1 };
    return edit("drive", { ...rest, coordinate, duration, law: next, ...numbers });
  };
  return (
    <fieldset>
      <label class="field">
        <span>Drive</span>
        <select value={name} onChange={(e) => void another(e.currentTarget.value)} aria-label="Driven coordinate">
          <option value={name}>
            {name} ({kind})
          </option>
          {free.map(option)}
          <option value="">nothing</option>
        </select>
      </label>
      <label class="field">
        <span>Law</span>
        <select value={law} aria-label="Law of motion" onChange={(e) => void byLaw(e.currentTarget.value)}>
          {!LAWS.some(([id]) => id === law) && <option value={law}>{law}</option>}
          {LAWS.map(([id, text]) => (
            <option key={id} value={id}>
              {text}
            </option>
          ))}
        </select>
      </label>
      <NumberField label="Start" unit={angle ? "°" : "m"} value={start} send={(v) => drive(angle ? { start_deg: v } : { start: v })} />
      {law === "constant" && (
        <NumberField label="Speed" unit={angle ? "rev/min" : "m/s"} value={rate === null ? null : angle ? (rate * 30) / Math.PI : rate} send={(v) => drive({ speed: angle ? (v! * Math.PI) / 30 : v })} />
      )}
      {law !== "constant" && law !== "table" && (
        <>
          <NumberField label="Travel" unit={angle ? "°" : "m"} value={value(angle ? "travel_deg" : "travel")} send={(v) => drive(angle ? { travel_deg: v } : { travel: v })} />
          <NumberField label="In" unit="s" value={value("time")} send={(v) => drive({ time: v })} />
        </>
      )}
    </fieldset>
  );
}

/** Returns a coordinate as text with its unit; angles are in degrees. */
const coordinate = (value: number | null, unit = ""): string => (unit === "rad" && value !== null ? `${((value * 180) / Math.PI).toFixed(1)}°` : amount(value, unit));

/** Returns the time of the sample whose input is nearest to a value. */
function passed(now: Motion, at: number | null): number {
  const turn = now.input?.unit === "rad" ? 2 * Math.PI : 0;
  const away = (v: number | null): number => (v === null || at === null ? Infinity : Math.abs(v - at - (turn && turn * Math.round((v - at) / turn))));
  const all = (now.input?.values ?? []).map(away);
  return now.times[all.indexOf(Math.min(...all))] ?? 0;
}

export function Timeline(): JSX.Element {
  const now = motion.value;
  const end = now?.times.at(-1) ?? 1;
  const own = scene.value?.scenarios.some((s) => s.kind === "driven"); // curves are shown if the linkage is driven, not while it is being drawn
  const list = now && (own || moving.value) ? curves.value : [];
  const input = now?.input;
  const i = now ? Math.max(0, now.times.findIndex((t) => t >= clock.value - 1e-12)) : 0;
  return (
    <section class={`timeline${sheet.value === "curves" ? " up" : ""}${open.value && list.length ? "" : " low"}`} aria-label="Motion">
      <div class="transport">
        <button type="button" class="play" aria-label={playing.value ? "Pause" : "Play"} title={playing.value ? "Pause (Space)" : "Play"} onClick={() => { choose("select"); void play(); }}>
          <Sign of={playing.value ? "pause" : "play"} />
        </button>
        <input
          type="range"
          aria-label="Time"
          min="0"
          max={end}
          step={end / 360}
          value={clock.value}
          disabled={!now}
          aria-valuetext={`${figure(clock.value, 3)} seconds`}
          onInput={(e) => scrub(Number(e.currentTarget.value))}
        />
        <output>
          {figure(clock.value, 3)} s
          {input && input.values[i] !== undefined && moving.value && <span class="input">{`, ${input.name} ${coordinate(input.values[i] ?? null, input.unit)}`}</span>}
        </output>
        <label class="pace">
          <span class="hidden">Pace</span>
          <select value={String(pace.value)} aria-label="Pace" onChange={(e) => (pace.value = Number(e.currentTarget.value))}>
            {[0.1, 0.25, 0.5, 1, 2].map((p) => (
              <option key={p} value={String(p)}>
                {p}×
              </option>
            ))}
          </select>
        </label>
        <Drive />
        <button
          type="button"
          class="quiet"
          aria-pressed={showCentres.value}
          aria-label="Instant centres"
          title="Points about which two links turn relative to each other at this instant"
          onClick={() => (showCentres.value = !showCentres.value)}
        >
          <span class="long">Instant centres</span>
          <span class="short">Centres</span>
        </button>
        <button type="button" class="quiet" title="Release the linkage under gravity and torques, and compare engines" onClick={() => (dialog.value = "release")}>
          Release
        </button>
        {moving.value && (
          <button type="button" class="quiet" aria-label="Back to the sketch" onClick={() => { still(); ghost.value = null; refresh(); }}>
            <span class="long">Back to the sketch</span>
            <span class="short">Sketch</span>
          </button>
        )}
        {list.length > 0 && (
          <button type="button" class="icon fold" aria-expanded={open.value} aria-label="Curves" title="Show or hide the curves" onClick={() => (open.value = !open.value)}>
            <Sign of="curves" />
          </button>
        )}
      </div>
      {now?.limits && <p class="note doubt">{retold(now.limits)}</p>}
      {motionNote.value && !now && <p class="note">{retold(motionNote.value)}</p>}
      {open.value && list.length > 0 && (
        <>
          <div class="chips which" role="group" aria-label="Curves shown">
            {list.map((c) => (
              <button
                type="button"
                key={c.id}
                aria-pressed={!off.value.has(c.id)}
                onClick={() => {
                  const next = new Set(off.value);
                  if (!next.delete(c.id)) next.add(c.id);
                  off.value = next;
                }}
              >
                {c.title}
              </button>
            ))}
            <button type="button" class="table" title="Download a table of all curves, also hidden ones, with their units" onClick={downloadTable}>
              CSV
            </button>
            {now!.singular.map((spot, n) => (
              <button type="button" key={n} class="flag" title={`Show the ${spot.kind} of ${spot.coordinate}`} onClick={() => scrub(passed(now!, spot.input))}>
                {spot.kind} of {spot.coordinate}
                {spot.input !== null && now!.input ? `, ${now!.input.name} at ${coordinate(spot.input, now!.input.unit)}` : ""}
              </button>
            ))}
          </div>
          <div class="charts" tabIndex={0} role="group" aria-label="Curves over time">{list.filter((c) => !off.value.has(c.id)).map((c) => <Plot key={c.id} chart={c} times={now!.times} at={under.value ?? clock.value} look={(at) => (under.value = at)} go={scrub} />)}</div>
        </>
      )}
    </section>
  );
}
