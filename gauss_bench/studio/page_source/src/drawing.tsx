// Draws the linkage with the symbols of engineering: bars, plates, pins, ground, slides, springs, dampers, torques, forces. Lines keep their width at any zoom.
import type { JSX } from "preact";
import { apart, between, direction, fromSegment, hull, middle } from "./geometry";
import type { Placed } from "./geometry";
import type { Force, Link, Pin, Slide, XY } from "./protocol";
import { chosen, drawn, scene } from "./state";
import { toScreen, view } from "./view";

const pen = (points: XY[], closed = false): string =>
  points.map((p, i) => `${i ? "L" : "M"}${p[0].toFixed(2)} ${p[1].toFixed(2)}`).join("") + (closed ? "Z" : "");
const screen = (points: XY[]): XY[] => points.map(toScreen);
const degrees = (angle: number): number => (-angle * 180) / Math.PI;
const troubled = (kind: string, id: string): string => {
  const named = drawn.value?.problems.filter((p) => p.where.includes(`${kind}.${id}`)) ?? [];
  return named.some((p) => p.level === "error") ? " wrong" : named.some((p) => p.level === "warning") ? " doubtful" : "";
};

export function LinkShape({ link, at, look = "" }: { link: Link; at: Placed; look?: string }): JSX.Element {
  const points = new Map(at.points(link));
  const all = screen([...points.values()]);
  const bars = link.bars.filter(([a, b]) => points.has(a) && points.has(b)).map(([a, b]) => screen([points.get(a)!, points.get(b)!]));
  const strokes = bars.length ? bars.map((bar) => pen(bar)).join("") : all.length === 2 ? pen(all) : "";
  const plate = all.length > 2 ? pen(hull(all), true) : "";
  const crank = scene.value?.crank === link.name ? " crank" : "";
  const state = `link${crank}${link.placed ? "" : " unplaced"}${chosen("link", link.name) ? " chosen" : ""}${look ? ` ${look}` : troubled("links", link.name)}`;
  return (
    <g class={state} data-link={look ? undefined : link.name}>
      {plate && <path class="plate" d={plate} />}
      {strokes && <path class="edge" d={strokes} />}
      {strokes && <path class="fill" d={strokes} />}
    </g>
  );
}

export function Ground({ at }: { at: XY }): JSX.Element {
  const [x, y] = toScreen(at);
  return (
    <g class="ground" transform={`translate(${x.toFixed(2)} ${y.toFixed(2)})`}>
      <path class="foot" d="M0 0L-11 19L11 19Z" />
      <path class="floor" d="M-18 19L18 19" />
      <path class="hatch" d="M-13 19l-5 6.5M-5 19l-5 6.5M3 19l-5 6.5M11 19l-5 6.5" />
    </g>
  );
}

export function PinMark({ pin, at, named }: { pin: Pin; at: Placed; named: boolean }): JSX.Element {
  const [x, y] = toScreen(at.pin(pin));
  const loose = pin.members.length < 2;
  const observed = pin.members.some((ref) => at.scene.observe.includes(ref));
  const state = `pin${loose ? " loose" : ""}${observed ? " observed" : ""}${chosen("pin", pin.id) ? " chosen" : ""}${troubled("pins", pin.id)}`;
  const name = pin.joint ?? pin.members[0]?.split(".")[1] ?? pin.id;
  return (
    <g class={state} transform={`translate(${x.toFixed(2)} ${y.toFixed(2)})`} data-pin={pin.id}>
      <circle class="halo" r="12" />
      {pin.members.length > 2 && <circle class="shared" r="8.2" />}
      <circle class="dot" r={loose ? 3.6 : 5} />
      {observed && <circle class="eye" r="2" />}
      {pin.locked && <path class="padlock" d="M7-13h9v7h-9zM9-13v-2.4a2.5 2.5 0 0 1 5 0v2.4" />}
      {named && (
        <text x="9" y="-9">
          {name}
        </text>
      )}
    </g>
  );
}

export function SlideMark({ slide, at }: { slide: Slide; at: Placed }): JSX.Element {
  const { angle, block, at: start } = at.slide(slide);
  const [x, y] = toScreen(block);
  const [gx, gy] = toScreen(start);
  const onGround = slide.guide.startsWith("ground.");
  const along = (gx - x) * Math.cos(angle) - (gy - y) * Math.sin(angle);
  const reach = Math.max(70, 0.12 * view.value.scale);
  const [from, to] = [Math.min(-reach, onGround ? along : 0), Math.max(reach, onGround ? along : 0)];
  const hatch = [];
  for (let s = from + 4; s < to; s += 10) hatch.push(`M${s.toFixed(1)} 12l-5 6.5`);
  return (
    <g
      class={`slide${chosen("slide", slide.id) ? " chosen" : ""}${troubled("slides", slide.id)}`}
      transform={`translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${degrees(angle).toFixed(3)})`}
      data-slide={slide.id}
    >
      {onGround ? (
        <>
          <path class="rail" d={`M${from.toFixed(1)} 12L${to.toFixed(1)} 12`} />
          <path class="hatch" d={hatch.join("")} />
        </>
      ) : (
        <path class="slot" d={`M${from.toFixed(1)} 0L${to.toFixed(1)} 0`} />
      )}
      <rect class="block" x="-17" y="-11" width="34" height="22" rx="3" />
      {slide.locked && <path class="padlock" d="M20-16h9v7h-9zM22-16v-2.4a2.5 2.5 0 0 1 5 0v2.4" />}
    </g>
  );
}

function coil(length: number): string {
  const lead = Math.min(14, length / 5);
  const turns = Math.max(4, Math.min(14, Math.round((length - 2 * lead) / 9)));
  const step = (length - 2 * lead) / turns;
  let d = `M0 0L${lead.toFixed(1)} 0`;
  for (let i = 0; i < turns; i++) d += `L${(lead + (i + 0.5) * step).toFixed(1)} ${i % 2 ? 7 : -7}`;
  return `${d}L${(length - lead).toFixed(1)} 0L${length.toFixed(1)} 0`;
}

function Stretched({ force, ends }: { force: Force; ends: [XY, XY] }): JSX.Element {
  const [a, b] = [toScreen(ends[0]), toScreen(ends[1])];
  const length = Math.max(Math.hypot(b[0] - a[0], b[1] - a[1]), 1);
  const table = force.table as { k?: number; c?: number };
  const cylinder = /cylinder|length/.test(force.type);
  const spring = !cylinder && (table.k ?? 0) !== 0;
  const damper = !cylinder && ((table.c ?? 0) !== 0 || !spring);
  const m = length / 2;
  return (
    <g transform={`translate(${a[0].toFixed(2)} ${a[1].toFixed(2)}) rotate(${((Math.atan2(b[1] - a[1], b[0] - a[0]) * 180) / Math.PI).toFixed(3)})`}>
      {cylinder && <path class="barrel" d={`M0-8L${(0.62 * length).toFixed(1)}-8L${(0.62 * length).toFixed(1)} 8L0 8Z`} />}
      {cylinder && <path class="wire" d={`M${(0.4 * length).toFixed(1)} 0L${length.toFixed(1)} 0M${(0.4 * length).toFixed(1)}-8L${(0.4 * length).toFixed(1)} 8`} />}
      {spring && <path class="wire" d={coil(length)} transform={damper ? "translate(0 -9)" : undefined} />}
      {damper && (
        <path
          class="wire"
          d={`M0 0L${(m - 8).toFixed(1)} 0M${(m + 9).toFixed(1)}-7L${(m - 8).toFixed(1)}-7L${(m - 8).toFixed(1)} 7L${(m + 9).toFixed(1)} 7M${(m + 3).toFixed(1)}-5L${(m + 3).toFixed(1)} 5M${(m + 3).toFixed(1)} 0L${length.toFixed(1)} 0`}
          transform={spring ? "translate(0 9)" : undefined}
        />
      )}
    </g>
  );
}

export function ForceMark({ force, at }: { force: Force; at: Placed }): JSX.Element | null {
  const ends = at.force(force);
  const first = ends[0];
  if (!first) return null;
  const [x, y] = toScreen(first);
  const state = `force${chosen("force", force.id) ? " chosen" : ""}${troubled("forces", force.id)}`;
  const value = force.table.value;
  let mark: JSX.Element;
  if (ends.length > 1 && !Array.isArray(value)) mark = <Stretched force={force} ends={[first, ends[1]!]} />;
  else if (force.type === "force") {
    const [fx, fy] = Array.isArray(value) ? (value as XY) : ends[1] ? ([ends[1][0] - first[0], ends[1][1] - first[1]] as XY) : ([0, -1] as XY);
    const turn = degrees(Math.atan2(fy, fx));
    mark = (
      <g transform={`translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${turn.toFixed(3)})`}>
        <path class="arrow" d="M6 0L58 0" />
        <path class="tip" d="M68 0L54-6L54 6Z" />
      </g>
    );
  } else if (force.type === "joint_damping" || force.type === "coulomb_friction") {
    mark = <circle class="wire brake" cx={x} cy={y} r="10.5" />;
  } else {
    const back = typeof value === "number" && value < 0 ? "scale(1 -1)" : "";
    mark = (
      <g transform={`translate(${x.toFixed(2)} ${y.toFixed(2)}) ${back}`}>
        <path class="arrow" d="M17.4 13.4A22 22 0 1 0 -17.4 13.4" />
        <path class="tip" d="M-11.5 21L-12.3 9.4L-22.5 17.300Z" />
      </g>
    );
  }
  return (
    <g class={state} data-force={force.id}>
      {mark}
    </g>
  );
}

/** The path of a point. */
export const Path = ({ points }: { points: XY[] }): JSX.Element => <path class="path" d={pen(screen(points))} />;

export function Linkage({ at, named, look = "" }: { at: Placed; named: boolean; look?: string }): JSX.Element {
  const { links, pins, slides, forces } = at.scene;
  if (look) {
    return (
      <g class="linkage">
        {links.map((link) => (
          <LinkShape key={link.name} link={link} at={at} look={look} />
        ))}
      </g>
    );
  }
  const guides = new Set(slides.map((slide) => slide.guide));
  const held = pins.filter((pin) => pin.ground && (pin.members.length > 1 || !guides.has(pin.members[0] ?? "")));
  const shownPin = (pin: Pin): boolean => !pin.ground || pin.members.length > 1 || !guides.has(pin.members[0] ?? "") || chosen("pin", pin.id);
  const [onGround, inSlots] = [slides.filter((s) => s.guide.startsWith("ground.")), slides.filter((s) => !s.guide.startsWith("ground."))];
  const owners = new Set(inSlots.map((s) => s.guide.split(".")[0]));
  return (
    <g class="linkage">
      {held.map((pin) => <Ground key={pin.id} at={at.pin(pin)} />)}
      {onGround.map((slide) => <SlideMark key={slide.id} slide={slide} at={at} />)}
      {links.filter((link) => owners.has(link.name)).map((link) => <LinkShape key={link.name} link={link} at={at} />)}
      {inSlots.map((slide) => <SlideMark key={slide.id} slide={slide} at={at} />)}
      {links.filter((link) => !owners.has(link.name)).map((link) => <LinkShape key={link.name} link={link} at={at} />)}
      {forces.map((force) => <ForceMark key={force.id} force={force} at={at} />)}
      {pins.filter(shownPin).map((pin) => <PinMark key={pin.id} pin={pin} at={at} named={named} />)}
      {named && links.filter((link) => Object.keys(link.points).length > 1).map((link) => <Label key={link.name} link={link} at={at} />)}
    </g>
  );
}

function Label({ link, at }: { link: Link; at: Placed }): JSX.Element {
  const points = at.points(link).map(([, p]) => p);
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const [a, b] = [sorted[0]!, sorted.at(-1)!];
  const straight = points.every((p) => fromSegment(p, a, b).distance < 1e-3 * apart(a, b));
  const [x, y] = toScreen(straight ? between(a, b, 0.3) : middle(points)); // not in the middle, where crossing bars meet
  const steep = points.length > 1 && Math.abs(Math.sin(direction(points[0]!, points[1]!))) > 0.6;
  return (
    <text class="name" x={x + (steep ? 12 : 0)} y={y + (steep ? 4 : -12)} text-anchor={steep ? "start" : "middle"}>
      {link.name}
    </text>
  );
}
