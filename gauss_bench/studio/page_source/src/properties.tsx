// The panel on the right: the numbers of the selected part or, without a selection, the linkage with its parts and problems.
import type { JSX } from "preact";
import { useState } from "preact/hooks";
import { Check, Lock, NumberField, Read, TextField } from "./fields";
import { apart, direction } from "./geometry";
import { Sign } from "./icons";
import type { Force, Link, Pin, Problem, Slide, XY } from "./protocol";
import { dialog, edit, placed, scene, selection, sheet, showCentres } from "./state";
import type { Picked } from "./state";
import { remove } from "./tools";
import { retold } from "./units";

/** Renames a part, which stays selected. */
async function rename(kind: "link" | "slide" | "force", old: string, to: string): Promise<void> {
  if (await edit("rename", { what: `${kind}s.${old}`, to })) selection.value = [{ kind, id: to }];
}

const set = (path: string, value: unknown): unknown => edit("set", { path, value });
const pairKey = (a: string, b: string): string => [a, b].sort().join("\n");
const degrees = (rad: number): number => Number(((rad * 180) / Math.PI).toFixed(6));

function LinkPanel({ link }: { link: Link }): JSX.Element {
  const points = new Map(placed.value!.points(link));
  const names = Object.keys(link.points);
  const pairs: [string, string][] = link.bars.length ? link.bars : names.slice(1).map((name) => [names[0]!, name]);
  const locked = new Set(link.locked.lengths.map(([a, b]) => pairKey(a, b)));
  const first = pairs[0];
  return (
    <>
      <TextField label="Name" value={link.name} send={(to) => rename("link", link.name, to)} />
      {pairs.map(([a, b]) => (
        <NumberField
          key={pairKey(a, b)}
          label={pairs.length > 1 ? `Length ${a}–${b}` : "Length"}
          unit="m"
          value={points.has(a) && points.has(b) ? apart(points.get(a)!, points.get(b)!) : null}
          send={(value) => edit("set_length", { link: link.name, a, b, value })}
        >
          <Lock of={`length ${a}–${b}`} on={locked.has(pairKey(a, b))} set={(on) => edit("lock", { link: link.name, a, b, on })} />
        </NumberField>
      ))}
      {first && points.has(first[0]) && points.has(first[1]) && (
        <NumberField
          label="Angle"
          unit="°"
          value={degrees(direction(points.get(first[0])!, points.get(first[1])!))}
          send={(value_deg) =>
            edit("set_angle", { link: link.name, value_deg: value_deg! - degrees(direction(points.get(first[0])!, points.get(first[1])!) - placed.value!.pose(link.name)[2]) })
          }
        >
          <Lock of="angle" on={link.locked.angle} set={(on) => edit("lock", { link: link.name, on })} />
        </NumberField>
      )}
      <Check label="Is the crank, whose angle is the motion's phase" on={scene.value!.crank === link.name} set={(on) => set("crank", on ? link.name : null)} />
      <h3>Mass</h3>
      <NumberField label="Mass per metre" unit="kg/m" value={link.kg_per_m} empty="none" send={(v) => set(`links.${link.name}.kg_per_m`, v)} />
      <NumberField label="Mass" unit="kg" value={link.mass} empty="of the bars" send={(v) => set(`links.${link.name}.mass`, v)} />
      <NumberField label="Inertia" unit="kg m²" value={link.inertia} empty="of the bars" send={(v) => set(`links.${link.name}.inertia`, v)} />
      <h3>Points</h3>
      <ul class="chips">
        {names.map((name) => {
          const ref = `${link.name}.${name}`;
          const on = scene.value!.observe.includes(ref);
          return (
            <li key={name}>
              <button type="button" aria-pressed={on} title={on ? `${ref} is observed` : `Observe ${ref}`} onClick={() => void edit("observe", { point: ref, on: !on })}>
                {name}
              </button>
            </li>
          );
        })}
      </ul>
    </>
  );
}

/** Returns the angle between the first two links that a pin joins, measured at the pin; the ground counts as horizontal. */
function angleIn(pin: Pin, at: XY): { names: string[]; degrees: number } | null {
  const ways = pin.members.flatMap((ref) => {
    const name = ref.split(".")[0]!;
    const link = placed.value!.link(name);
    if (!link) return name === "ground" ? [{ name, way: 0 }] : [];
    const far = placed.value!.points(link).map(([, p]) => p).sort((p, q) => apart(q, at) - apart(p, at))[0]!;
    return [{ name, way: apart(far, at) > 1e-6 ? direction(at, far) : placed.value!.pose(name)[2] }];
  });
  const [a, b] = ways;
  if (!a || !b) return null;
  const turn = degrees(b.way - a.way) % 360;
  return { names: [a.name, b.name], degrees: turn > 180 ? turn - 360 : turn < -180 ? turn + 360 : turn };
}

const nameOf = (pin: Pin): string => pin.joint ?? pin.members[0] ?? pin.id;

/** Joins a pin with another one that the user chooses by its name, without a pointer. */
function Join({ pin }: { pin: Pin }): JSX.Element {
  const [to, setTo] = useState("");
  return (
    <div class="field">
      <span>Join with</span>
      <span class="entry">
        <select aria-label="Join with" value={to} onChange={(e) => setTo(e.currentTarget.value)}>
          <option value="">another pin</option>
          {scene.value!.pins.filter((p) => p.id !== pin.id).map((p) => (
            <option key={p.id} value={p.id}>
              {nameOf(p)}
            </option>
          ))}
        </select>
        <button type="button" class="quiet" disabled={!to} onClick={() => void edit("join", { pin: pin.id, to })}>
          Join
        </button>
      </span>
    </div>
  );
}

function PinPanel({ pin }: { pin: Pin }): JSX.Element {
  const at = placed.value!.pin(pin);
  const put = (to: XY): unknown => edit("move", { pin: pin.id, at: to });
  const point = pin.members.find((ref) => !ref.startsWith("ground."));
  const loose = pin.members.length < 2;
  const turns = angleIn(pin, at);
  return (
    <>
      <TextField label="Name" value={pin.joint ?? pin.members[0]?.split(".")[1] ?? pin.id} send={(to) => edit("rename", { what: `pins.${pin.id}`, to })} />
      <NumberField label="x" unit="m" value={at[0]} send={(x) => put([x!, at[1]])}>
        <Lock of="place" on={pin.locked} set={(on) => edit("lock", { pin: pin.id, on })} />
      </NumberField>
      <NumberField label="y" unit="m" value={at[1]} send={(y) => put([at[0], y!])}>
        <span class="lock" aria-hidden="true" />
      </NumberField>
      <Check label="Fixed to the ground" on={pin.ground} set={(on) => edit("ground", { pin: pin.id, on })} />
      {turns && (
        <p class="field" title={`Between ${turns.names.join(" and ")}, seen from the pin`}>
          <span>Angle</span>
          <span class="entry">
            <output>{turns.degrees.toFixed(2)}</output>
            <small>°</small>
            <Lock of="angle between the links" on={pin.stiff} set={(on) => edit("lock", { joint: pin.id, on })} />
          </span>
        </p>
      )}
      {point && <Check label="Observed: path, velocity, acceleration" on={pin.members.some((ref) => scene.value!.observe.includes(ref))} set={(on) => edit("observe", { point: pin.members.find((ref) => scene.value!.observe.includes(ref)) ?? point, on })} />}
      <Join pin={pin} />
      <p class="note">{loose ? "Nothing is joined here yet. Draw a bar to it, or put another pin on it with Reshape." : `Joins ${pin.members.map((ref) => ref.split(".")[0]).join(", ")}.`}</p>
    </>
  );
}

function SlidePanel({ slide }: { slide: Slide }): JSX.Element {
  const { angle } = placed.value!.slide(slide);
  return (
    <>
      <TextField label="Name" value={slide.id} send={(to) => rename("slide", slide.id, to)} />
      <p class="note">
        {slide.block} slides along a line of {slide.guide.split(".")[0]}, now at {degrees(angle).toFixed(1)}° to the horizontal.
      </p>
      {slide.guide.startsWith("ground.") && <NumberField label="Direction" unit="°" value={degrees(angle)} send={(v) => set(`joints.${slide.id}.angle_deg`, v)} />}
      <div class="row">
        <Lock of="slide" on={slide.locked} set={(on) => edit("lock", { slide: slide.id, on })} /> <small class="note">Locked, a drag keeps it where it is.</small>
      </div>
      <NumberField label="Offset" unit="m" value={slide.offset} empty="0" send={(v) => set(`joints.${slide.id}.offset`, v)} />
    </>
  );
}

const UNITS: Record<string, string> = { k: "N/m", c: "N s/m", rest: "m", mu: "", radius: "m", speed: "m/s", angle: "rad", angle_deg: "°", rest_deg: "°" };
const TURNING: Record<string, string> = { k: "N m/rad", c: "N m s/rad", rest: "rad", speed: "rad/s" };
const WORDS: Record<string, string> = { k: "Stiffness", c: "Damping", rest: "Length at rest", mu: "Friction", radius: "Pin radius", value: "Value", speed: "Speed", rest_deg: "Angle at rest", angle_deg: "Direction" };

function ForcePanel({ force }: { force: Force }): JSX.Element {
  const turning = force.type.startsWith("rotational") || force.type === "torque" || scene.value!.pins.some((p) => p.joint === force.table.joint);
  const table = { ...(force.type === "spring_damper" ? { k: 0, c: 0, rest: 0 } : {}), ...force.table };
  const unit = (key: string): string => (key === "value" ? (force.type === "torque" ? "N m" : "N") : ((turning ? TURNING[key] : undefined) ?? UNITS[key] ?? ""));
  const path = (key: string): string => `forces.${force.id}.${key}`;
  return (
    <>
      <TextField label="Name" value={force.id} send={(to) => rename("force", force.id, to)} />
      <p class="note">{force.label || force.type.replaceAll("_", " ")}</p>
      {Object.entries(table).map(([key, value]) => {
        if (typeof value === "number") return <NumberField key={key} label={WORDS[key] ?? key} unit={unit(key)} value={value} send={(v) => set(path(key), v)} />;
        if (key === "value" && Array.isArray(value)) {
          const [fx, fy] = value as XY;
          return (
            <>
              <NumberField label="Force x" unit="N" value={fx} send={(v) => set(path(key), [v, fy])} />
              <NumberField label="Force y" unit="N" value={fy} send={(v) => set(path(key), [fx, v])} />
            </>
          );
        }
        return key === "type" ? null : <p class="read" key={key}><span>{WORDS[key] ?? key}</span><b>{Array.isArray(value) ? (value as unknown[]).join(", ") : typeof value === "object" ? "…" : String(value)}</b></p>;
      })}
    </>
  );
}

export function Problems(): JSX.Element | null {
  const list = scene.value?.problems ?? [];
  if (!list.length) return null;
  return (
    <section class="problems" aria-label="Problems">
      <ul>
        {list.map((problem, i) => (
          <li key={i} class={problem.level}>
            <button type="button" onClick={() => show(problem)}>
              <span class="level">{{ error: "Error", warning: "Warning", hint: "Hint" }[problem.level]}</span>
              {retold(problem.text)}
              {problem.loop && <small>Loop {problem.loop.join(" – ")}</small>}
            </button>
          </li>
        ))}
      </ul>
    </section>
  );
}

export function show(problem: Problem): void {
  const kinds: Record<string, Picked["kind"]> = { links: "link", pins: "pin", slides: "slide", forces: "force" };
  const out: Picked[] = problem.where.flatMap((id) => {
    const dot = id.indexOf(".");
    const kind = kinds[id.slice(0, dot)];
    return kind ? [{ kind, id: id.slice(dot + 1) }] : [];
  });
  if (out.length) selection.value = out;
}

/** A part in the list of all parts; a link has its number if instant centres are named by it. */
function Part({ kind, id, text, number }: { kind: Picked["kind"]; id: string; text: string; number?: number }): JSX.Element {
  return (
    <li>
      <button type="button" aria-label={`${kind} ${text}`} onClick={() => (selection.value = [{ kind, id }])}>
        {number !== undefined && <small>{number}</small>}
        {text}
      </button>
    </li>
  );
}

function Whole(): JSX.Element {
  const now = scene.value!;
  const parts = now.links.length + now.pins.length;
  return (
    <>
      <TextField label="Name" value={now.name} send={(v) => set("name", v)} />
      <TextField label="Title" value={now.title} send={(v) => set("title", v)} />
      <NumberField label="Gravity x" unit="m/s²" value={now.gravity[0]} send={(v) => set("gravity", [v, now.gravity[1]])} />
      <NumberField label="Gravity y" unit="m/s²" value={now.gravity[1]} send={(v) => set("gravity", [now.gravity[0], v])} />
      {parts > 0 && (
        <div class="row">
          <button type="button" class="quiet" onClick={() => (dialog.value = "branches")}>
            <Sign of="branch" /> Other assemblies
          </button>
        </div>
      )}
      {now.links.length > 0 && <h3>Links</h3>}
      <ul class="chips">{now.links.map((l, i) => <Part key={l.name} kind="link" id={l.name} text={l.name} number={showCentres.value ? i + 1 : undefined} />)}</ul>
      {now.pins.length > 0 && <h3>Pins</h3>}
      <ul class="chips">{now.pins.map((p) => <Part key={p.id} kind="pin" id={p.id} text={nameOf(p)} />)}</ul>
      {now.slides.length + now.forces.length > 0 && <h3>Slides and forces</h3>}
      <ul class="chips">
        {now.slides.map((s) => <Part key={s.id} kind="slide" id={s.id} text={s.id} />)}
        {now.forces.map((f) => <Part key={f.id} kind="force" id={f.id} text={f.id} />)}
      </ul>
      {now.status.loop_names.length > 0 && (
        <>
          <h3>Independent loops</h3>
          <ol class="loops" data-testid="loops">
            {now.status.loop_names.map((loop, i) => (
              <li key={i}>
                <button type="button" onClick={() => (selection.value = loop.filter((n) => n !== "ground").map((id) => ({ kind: "link", id })))}>
                  {loop.join(" – ")}
                </button>
              </li>
            ))}
          </ol>
        </>
      )}
    </>
  );
}

export function Properties(): JSX.Element {
  const now = scene.value;
  const picked = selection.value;
  const one = picked.length === 1 ? picked[0]! : null;
  const link = one?.kind === "link" && now?.links.find((l) => l.name === one.id);
  const pin = one?.kind === "pin" && now?.pins.find((p) => p.id === one.id);
  const slide = one?.kind === "slide" && now?.slides.find((s) => s.id === one.id);
  const force = one?.kind === "force" && now?.forces.find((f) => f.id === one.id);
  const heading = link ? "Link" : pin ? (pin.ground ? "Ground pivot" : "Pin") : slide ? "Slide" : force ? "Force" : picked.length ? `${picked.length} things` : "Linkage";
  return (
    <aside id="properties" class={`properties${sheet.value === "properties" ? " up" : ""}`} aria-label="Properties">
      <header>
        <h2>{heading}</h2>
        {picked.length > 0 && (
          <>
            <button type="button" class="icon" aria-label="Delete" title="Delete (Del)" onClick={() => void remove()}>
              <Sign of="trash" />
            </button>
            <button type="button" class="icon" aria-label="Select nothing" title="Select nothing (Esc)" onClick={() => (selection.value = [])}>
              <Sign of="close" />
            </button>
          </>
        )}
        <button type="button" class="icon sheet-close" aria-label="Close properties" onClick={() => (sheet.value = "")}>
          <Sign of="down" />
        </button>
      </header>
      <Problems />
      <div class="fields" key={one ? `${one.kind} ${one.id}` : "whole"}>
        {link ? <LinkPanel link={link} /> : pin ? <PinPanel pin={pin} /> : slide ? <SlidePanel slide={slide} /> : force ? <ForcePanel force={force} /> : now && !picked.length ? <Whole /> : null}
        {picked.length === 2 && picked.every((p) => p.kind === "pin") && <TwoPins ids={picked.map((p) => p.id)} />}
      </div>
    </aside>
  );
}

function TwoPins({ ids }: { ids: string[] }): JSX.Element {
  const [a, b] = ids.map((id) => placed.value!.pin(scene.value!.pins.find((p) => p.id === id)!));
  return (
    <>
      <Read label="Distance" value={apart(a!, b!)} unit="m" />
      <button type="button" onClick={() => void edit("join", { pin: ids[0], to: ids[1] })}>
        Join the two
      </button>
    </>
  );
}
