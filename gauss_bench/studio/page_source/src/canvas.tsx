// The drawing area: grid, picture, paths, linkage, second motion, present picks; pointer, touch and keyboard.
import { batch, signal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { centres, pulled } from "./centres";
import { Linkage, Path } from "./drawing";
import { Placed, apart, middle } from "./geometry";
import { target } from "./hit";
import type { Target } from "./hit";
import { Poses as ThreePoses } from "./poses";
import type { Centre, Pin, Poses, Scene, XY } from "./protocol";
import { ask, pending } from "./socket";
import {
  behind, chosen, clock, dialog, dragged, edit, follow, frames, ghosted, inView, lined, motion, moving, placed, play, said, say, scene, selection, settling,
  show, showCentres, still, take, trial,
} from "./state";
import type { Picked } from "./state";
import { TOOLS, cancel, choose, current, finish, hover, pick, picks, remove, tool } from "./tools";
import { amount } from "./units";
import { onGrid, pan, size, steps, toScreen, toWorld, view, zoom } from "./view";

export const names = signal(false);
const cursor = signal<XY | null>(null); // place of the keyboard's cross in the world
const reshaped = signal<{ pin: string; at: XY } | null>(null);

// Dragging: only the newest place of the pointer is sent, after the reply to the last one.
let drag: { on: boolean; next: XY | null; waiting: boolean; ended: null | boolean; over: () => void } | null = null;
let going = 0; // number of drags that have not ended
let last = Promise.resolve(); // resolves when the previous drag has ended, because the server has one drag at a time

async function beginDrag(pin: string, at: XY): Promise<void> {
  still();
  const before = last;
  let over = (): void => undefined;
  going += 1;
  last = new Promise((done) => {
    over = () => {
      going -= 1;
      done();
    };
  });
  const mine = { on: false, next: null as XY | null, waiting: true, ended: null as boolean | null, over };
  drag = mine;
  frames.value = { solved: 0, ms: 0, jump: 0 };
  await before;
  try {
    await ask("drag_begin", { pin, at });
    mine.on = true;
  } catch (error) {
    say((error as Error).message, "error");
    if (drag === mine) drag = null;
    over();
    return;
  }
  mine.waiting = false;
  void pull(mine);
}

async function pull(mine: NonNullable<typeof drag>): Promise<void> {
  if (mine.waiting) return;
  if (mine.next) {
    const at = mine.next;
    mine.next = null;
    mine.waiting = true;
    try {
      const reply = (await ask("drag", { at, centres: showCentres.value })) as unknown as { poses: Poses; reached: boolean; ms: number; note: string | null; centres?: Centre[] };
      const before = dragged.value ?? reply.poses;
      const jump = Math.max(0, ...Object.entries(reply.poses).map(([name, p]) => Math.abs(p[2] - before[name]![2])));
      if (drag === mine)
        batch(() => {
          dragged.value = reply.poses;
          pulled.value = reply.centres ?? null;
        });
      frames.value = { solved: frames.value.solved + 1, ms: frames.value.ms + reply.ms, jump: Math.max(frames.value.jump, jump) };
      if (reply.note && !reply.reached) say(reply.note);
      else if (said.value?.level === "info") said.value = null;
    } catch (error) {
      say((error as Error).message, "error");
    }
    mine.waiting = false;
    return pull(mine);
  }
  if (mine.ended !== null) {
    const keep = mine.ended;
    if (drag === mine) drag = null;
    try {
      const reply = await ask("drag_end", { keep });
      if (reply.scene) take(reply.scene as Scene);
    } catch (error) {
      say((error as Error).message, "error");
    }
    if (!drag) dragged.value = null;
    mine.over();
  }
}

function endDrag(keep: boolean): void {
  if (!drag) return;
  drag.ended = keep;
  if (drag.on) void pull(drag);
}

/** Whether dragging a pin moves the linkage; otherwise it changes lengths. */
const movable = (pin: Pin): boolean => !pin.ground && scene.value!.status.assembles && (scene.value!.status.dof ?? 0) > 0;

// All steps of an arrow key that is held belong to one drag of the selected pin.
let led: { pin: string; at: XY; held: boolean } | null = null;

function lead(pin: Pin, by: XY): void {
  if (!led?.held || led.pin !== pin.id || !drag) {
    const at = going && led?.pin === pin.id ? led.at : placed.value!.pin(pin); // the poses after earlier key presses may not be shown yet
    led = { pin: pin.id, at, held: true };
    void beginDrag(pin.id, at);
  }
  led.at = [led.at[0] + by[0], led.at[1] + by[1]];
  drag!.next = led.at;
  if (drag!.on) void pull(drag!);
}

function leave(): void {
  if (!led?.held) return;
  endDrag(true);
  led.held = false;
}

// Moving a pin: the links are shown as they would be after the move; again only the newest place is sent.
let trying: XY | null = null;
let tested = false;

async function tryOut(): Promise<void> {
  if (tested) return;
  tested = true;
  for (let now = reshaped.value; now && trying; now = reshaped.value) {
    const at = trying;
    trying = null;
    try {
      const reply = await ask("move", { pin: now.pin, at, trial: true });
      if (reshaped.value?.pin === now.pin) trial.value = reply.trial as Scene;
      frames.value = { ...frames.value, solved: frames.value.solved + 1 };
      if (said.value) said.value = null;
    } catch (error) {
      say((error as Error).message, "error");
    }
  }
  tested = false;
}

/** Ends the move: makes it, or leaves the drawing unchanged. */
function endReshape(keep: boolean): void {
  const now = reshaped.value;
  reshaped.value = trying = null;
  if (now && keep) void edit("move", now).then((reply) => reply || (trial.value = null));
  else trial.value = null;
}

const fingers = new Map<number, XY>();
let pressed: { at: XY; hit: Target; mode: "none" | "pan" | "drag" | "reshape" | "draw"; far: boolean; pin: string | null } | null = null;
let spread = 0;

export function Canvas(): JSX.Element {
  const ref = useRef<SVGSVGElement>(null);
  const here = (e: { clientX: number; clientY: number }): XY => {
    const box = ref.current!.getBoundingClientRect();
    return [e.clientX - box.left, e.clientY - box.top];
  };
  const look = (e: PointerEvent): Target => target(placed.value!, here(e), e.pointerType === "touch" ? 24 : 13, e.altKey || !lined.value);

  useEffect(() => {
    const svg = ref.current!;
    const watch = new ResizeObserver(() => {
      const box = svg.getBoundingClientRect();
      if (!box.width) return;
      const first = size.value[0] === 800 && size.value[1] === 600;
      const [dx, dy] = [(box.width - size.value[0]) / 2, (box.height - size.value[1]) / 2];
      const seen = inView();
      size.value = [box.width, box.height];
      if (first || settling()) show();
      else if (tool.value === "select" && !pressed) { // otherwise the drawn or dragged part stays under the pointer
        pan(dx, dy);
        if (seen) follow(); // if the curves open or the window gets smaller, a sketch that was shown as a whole still is
      }
    });
    watch.observe(svg);
    const wheel = (e: WheelEvent): void => {
      e.preventDefault();
      if (e.ctrlKey || !e.shiftKey) zoom(Math.exp(-e.deltaY * (e.ctrlKey ? 0.01 : 0.0016)), here(e));
      else pan(-e.deltaY, -e.deltaX);
    };
    svg.addEventListener("wheel", wheel, { passive: false });
    return () => {
      watch.disconnect();
      svg.removeEventListener("wheel", wheel);
    };
  }, []);

  const down = (e: PointerEvent): void => {
    if (!placed.value) return;
    ref.current!.focus({ preventScroll: true });
    ref.current!.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, here(e));
    cursor.value = null;
    if (fingers.size === 2) {
      endDrag(false);
      pressed = null;
      endReshape(false);
      const [a, b] = [...fingers.values()] as [XY, XY];
      spread = apart(a, b);
      return;
    }
    const hit = look(e);
    const hand = tool.value;
    const base = { at: here(e), hit, far: false, pin: hit.pin };
    if (e.button === 1 || e.button === 2 || (hand === "select" && !hit.over)) pressed = { ...base, mode: "pan" };
    else if (hand === "select") pressed = { ...base, mode: "none" };
    else if (hand === "reshape") pressed = { ...base, mode: hit.pin !== null ? "reshape" : "pan" };
    else {
      pressed = { ...base, mode: "draw" };
      pick(hit);
    }
  };

  const move = (e: PointerEvent): void => {
    if (!placed.value) return;
    const at = here(e);
    if (fingers.size === 2 && fingers.has(e.pointerId)) {
      const old = [...fingers.values()] as [XY, XY];
      fingers.set(e.pointerId, at);
      const now = [...fingers.values()] as [XY, XY];
      const [m, n] = [middle(old), middle(now)];
      pan(n[0] - m[0], n[1] - m[1]);
      if (spread > 0 && apart(...now) > 0) zoom(apart(...now) / spread, n);
      spread = apart(...now);
      return;
    }
    const before = fingers.get(e.pointerId);
    if (fingers.has(e.pointerId)) fingers.set(e.pointerId, at);
    if (!pressed) {
      if (tool.value !== "select" || e.pointerType === "mouse") hover.value = look(e);
      return;
    }
    if (!pressed.far && apart(at, pressed.at) < 4) return;
    if (!pressed.far) {
      pressed.far = true;
      if (pressed.mode === "none" && tool.value === "select") startPull(e);
    }
    if (pressed.mode === "pan" && before) pan(at[0] - before[0], at[1] - before[1]);
    else if (pressed.mode === "drag" && drag) {
      drag.next = toWorld(at);
      if (drag.on) void pull(drag);
    } else if (pressed.mode === "reshape" && pressed.pin !== null) {
      const snap = look(e);
      if (!reshaped.value) frames.value = { solved: 0, ms: 0, jump: 0 };
      trying = snap.pin === pressed.pin ? (e.altKey || !lined.value ? toWorld(at) : onGrid(toWorld(at))) : snap.at;
      reshaped.value = { pin: pressed.pin, at: trying };
      if (snap.pin === null || snap.pin === pressed.pin) void tryOut();
    } else if (pressed.mode === "draw") hover.value = look(e);
  };

  /** Begins a drag with Select: a joint that can move is dragged; a fixed joint, or one of a linkage that does not assemble, is moved. */
  const startPull = (e: PointerEvent): void => {
    const { hit } = pressed!;
    const grip = hit.pin ?? nearestOf(hit, here(e));
    if (grip === null) {
      pressed!.mode = "pan";
      return;
    }
    const pin = scene.value!.pins.find((p) => p.id === grip)!;
    const status = scene.value!.status;
    selection.value = [{ kind: "pin", id: grip }];
    if (movable(pin) && !e.shiftKey) {
      pressed!.mode = "drag";
      void beginDrag(grip, placed.value!.pin(pin));
    } else {
      pressed!.mode = "reshape";
      pressed!.pin = grip;
      still();
      if (!pin.ground && !e.shiftKey && status.dof === 0) say("Nothing can move: dragging changes the lengths instead.");
    }
  };
  const nearestOf = (hit: Target, at: XY): string | null => {
    if (hit.over?.kind !== "link") return null;
    const own = scene.value!.pins.filter((p) => p.members.some((ref) => ref.startsWith(`${hit.over!.id}.`)));
    own.sort((p, q) => apart(toScreen(placed.value!.pin(p)), at) - apart(toScreen(placed.value!.pin(q)), at));
    return (own.find((p) => !p.ground) ?? own[0])?.id ?? null;
  };

  const up = (e: PointerEvent): void => {
    fingers.delete(e.pointerId);
    if (!pressed) return;
    const { mode, far, hit, pin, at } = pressed;
    pressed = null;
    if (mode === "drag") endDrag(true);
    else if (mode === "reshape" && far && pin !== null) {
      const join = look(e);
      const joins = join.pin !== null && join.pin !== pin && tool.value === "reshape";
      endReshape(!joins);
      if (joins) void edit("join", { pin, to: join.pin });
    } else if (mode === "draw" && far && apart(here(e), at) > 10 && picks.value.length) pick(look(e));
    else if (!far && tool.value === "select" && e.button === 0) {
      select(hit.over, e.shiftKey);
    }
  };
  const lost = (e: PointerEvent): void => {
    fingers.delete(e.pointerId);
    endDrag(false);
    endReshape(false);
    pressed = null;
  };

  /** Selects one part or nothing; with `more`, adds the part to the selection or removes it. */
  const select = (over: Picked | null, more: boolean): void => {
    const had = selection.value;
    if (!over || !more) selection.value = over ? [over] : more ? had : [];
    else selection.value = chosen(over.kind, over.id) ? had.filter((p) => p.id !== over.id || p.kind !== over.kind) : [...had, over];
  };

  const key = (e: KeyboardEvent): void => {
    if (!placed.value || e.ctrlKey || e.metaKey) return;
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (by) {
      e.preventDefault();
      const step = steps.value.fine * (e.shiftKey ? 5 : 1);
      const chosenPin = selection.value[0]?.kind === "pin" ? scene.value!.pins.find((p) => p.id === selection.value[0]!.id) : undefined;
      if (tool.value === "select" && chosenPin && movable(chosenPin)) return lead(chosenPin, [by[0]! * step, by[1]! * step]);
      if ((tool.value === "select" || tool.value === "reshape") && chosenPin) {
        const round = (v: number): number => Number(v.toFixed(9));
        void edit("move", { pin: chosenPin.id, at: [round(chosenPin.at[0] + by[0]! * step), round(chosenPin.at[1] + by[1]! * step)] });
        return;
      }
      const from = cursor.value ?? toWorld([size.value[0] / 2, size.value[1] / 2]);
      cursor.value = [from[0] + by[0]! * step, from[1] + by[1]! * step];
      const snap = target(placed.value, toScreen(cursor.value), 8, !lined.value);
      hover.value = snap;
      if (snap.pin === null && lined.value) cursor.value = snap.at;
    } else if ((e.key === "Enter" || e.key === " ") && current().open && picks.value.length > 2 && e.key === "Enter") {
      e.preventDefault();
      finish();
    } else if ((e.key === "Enter" || e.key === " ") && cursor.value) {
      e.preventDefault();
      const snap = target(placed.value, toScreen(cursor.value), 8, !lined.value);
      if (tool.value === "select" || tool.value === "reshape") select(snap.over, e.shiftKey);
      else pick(snap);
    } else if (e.key === "Delete" || e.key === "Backspace") {
      e.preventDefault();
      void remove();
    } else if (e.key === "Escape") {
      led = null;
      if (drag) endDrag(false);
      else if (reshaped.value) {
        pressed = null;
        endReshape(false);
      } else {
        cursor.value = null;
        cancel();
      }
    } else if (e.key === "+" || e.key === "=") zoom(1.25);
    else if (e.key === "-") zoom(0.8);
    else if (e.key === "0") show();
  };

  const { scale, origin } = view.value;
  const now = placed.value;
  const title = scene.value ? `${scene.value.title || scene.value.name}: ${scene.value.links.length} links, ${scene.value.pins.length} pins` : "";
  return (
    <svg
      ref={ref}
      id="canvas"
      class={`canvas tool-${tool.value}${pressed?.mode === "drag" ? " dragging" : ""}`}
      role="application"
      aria-label="Drawing area"
      aria-roledescription="drawing"
      aria-describedby="canvas-help"
      tabindex={0}
      data-scale={scale}
      data-origin={`${origin[0]},${origin[1]}`}
      data-frames={frames.value.solved}
      data-ms={frames.value.ms}
      data-jump={frames.value.jump}
      data-pending={pending.value}
      data-revision={scene.value?.revision}
      onPointerDown={down}
      onPointerMove={move}
      onPointerUp={up}
      onPointerCancel={lost}
      onPointerLeave={() => !pressed && (hover.value = null)}
      onDblClick={() => current().open && picks.value.length > 2 && finish()}
      onContextMenu={(e) => e.preventDefault()}
      onKeyDown={key}
      onKeyUp={(e) => e.key.startsWith("Arrow") && leave()}
      onBlur={leave}
    >
      <title>{title}</title>
      <Behind />
      <Grid />
      <Paths />
      {now && <Linkage at={now} named={names.value} />}
      {ghosted.value && <Linkage at={ghosted.value} named={false} look="ghost" />}
      <Velocities />
      <Reshape />
      <Centres />
      <ThreePoses />
      <Drawn />
    </svg>
  );
}

function Behind(): JSX.Element | null {
  const picture = scene.value?.picture;
  if (!picture || !behind.value) return null;
  const [x, y] = toScreen([picture.at[0], picture.at[1] + picture.height]);
  const { scale } = view.value;
  return <image class="behind" href={behind.value.url} x={x} y={y} width={picture.width * scale} height={picture.height * scale} preserveAspectRatio="none" />;
}

function Grid(): JSX.Element {
  const { fine, strong } = steps.value;
  const { scale, origin } = view.value;
  const [w, h] = size.value;
  const lines = (step: number): string => {
    let d = "";
    const gap = step * scale;
    for (let x = ((origin[0] % gap) + gap) % gap; x < w; x += gap) d += `M${x.toFixed(1)} 0V${h}`;
    for (let y = ((origin[1] % gap) + gap) % gap; y < h; y += gap) d += `M0 ${y.toFixed(1)}H${w}`;
    return d;
  };
  const bar = strong * scale;
  return (
    <g class="grid" aria-hidden="true">
      <path class="fine" d={lines(fine)} />
      <path class="bold" d={lines(strong)} />
      <path class="axis" d={`M${origin[0].toFixed(1)} 0V${h}M0 ${origin[1].toFixed(1)}H${w}`} />
      <g transform={`translate(${w - bar - 18} ${h - 16})`}>
        <path class="ruler" d={`M0-5V0H${bar.toFixed(1)}V-5`} />
        <text x={bar / 2} y="-6" text-anchor="middle">
          {amount(strong, "m")}
        </text>
      </g>
    </g>
  );
}

function Paths(): JSX.Element | null {
  const now = motion.value;
  if (!now) return null;
  return (
    <g class="paths">
      {Object.entries(now.points).map(([ref, series], n) => (
        <g key={ref} class={`curve-${n % 6}`} data-path={ref}>
          <Path points={series.p} />
        </g>
      ))}
      {now.singular.map(({ coordinate, poses }, n) => poses && <Singular key={n} spot={{ coordinate, poses }} />)}
    </g>
  );
}

/** The velocities of the observed points at the shown time; the largest velocity of each point is 80 pixels long. */
function Velocities(): JSX.Element | null {
  const now = motion.value;
  const points = placed.value;
  if (!now || !points || !moving.value || dragged.value) return null;
  const i = Math.max(0, now.times.findIndex((t) => t >= clock.value - 1e-12));
  return (
    <g class="velocities">
      {Object.entries(now.points).map(([ref, { p, v }], n) => v && <Vector key={ref} hue={n % 6} from={points.point(ref) ?? p[i]!} by={v[i]} most={peak(v)} />)}
    </g>
  );
}

const peak = (list: XY[]): number => Math.max(1e-12, ...list.map((v) => Math.hypot(v[0] ?? 0, v[1] ?? 0)));

function Vector({ hue, from, by, most }: { hue: number; from: XY; by: XY | undefined; most: number }): JSX.Element | null {
  if (!by) return null;
  const [x, y] = toScreen(from);
  const length = (80 * Math.hypot(by[0], by[1])) / most;
  if (length < 4) return null;
  const turn = (-Math.atan2(by[1], by[0]) * 180) / Math.PI;
  return (
    <g class={`velocity curve-${hue}`} transform={`translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${turn.toFixed(2)})`}>
      <path d={`M0 0L${(length - 6).toFixed(1)} 0`} />
      <path class="tip" d={`M${length.toFixed(1)} 0l-9-4v8z`} />
    </g>
  );
}

/** Singular positions: a diamond on each moving joint of the link or slide that stands still or reverses there. */
function Singular({ spot: { coordinate, poses } }: { spot: { coordinate: string; poses: Poses } }): JSX.Element {
  const { links, pins, slides } = scene.value!;
  const slider = slides.find((s) => s.id === coordinate)?.block.split(".")[0];
  const one = links.find((l) => l.name === (slider ?? coordinate))?.name;
  const at = new Placed(scene.value!, poses);
  const marks = pins
    .filter((p) => !p.ground && p.joint !== null && p.members.some((ref) => (one ? ref.startsWith(`${one}.`) : ref.split(".")[0]! in poses)))
    .map((p) => toScreen(at.pin(p)));
  return <path class="singular" d={marks.map(([x, y]) => `M${x.toFixed(1)} ${(y - 6).toFixed(1)}l6 6l-6 6l-6-6z`).join("")} />;
}

function Reshape(): JSX.Element | null {
  const now = reshaped.value;
  const pin = now && scene.value?.pins.find((p) => p.id === now.pin);
  if (!now || !pin) return null;
  const [x, y] = toScreen(now.at);
  const others = pin.members.flatMap((ref) => {
    const link = placed.value!.link(ref.split(".")[0]!);
    return link ? placed.value!.points(link).filter(([name]) => `${link.name}.${name}` !== ref).map(([, p]) => p) : [];
  });
  return (
    <g class="rubber">
      {others.map((p, i) => {
        const [a, b] = toScreen(p);
        const m = middle([[x, y], [a, b]]);
        return (
          <g key={i}>
            <path d={`M${x} ${y}L${a} ${b}`} />
            <text x={m[0]} y={m[1] - 8}>
              {amount(apart(p, now.at), "m")}
            </text>
          </g>
        );
      })}
      <circle cx={x} cy={y} r="6" />
    </g>
  );
}

/** The instant centres of all pairs of links, with the numbers of the links; if links are selected, only those of these links. */
function Centres(): JSX.Element {
  const order = ["ground", ...(scene.value?.links.map((l) => l.name) ?? [])];
  const few = selection.value.filter((p) => p.kind === "link").map((p) => p.id);
  return (
    <g class="centres">
      {centres.value.filter((c) => !few.length || c.links.some((name) => few.includes(name))).map((c) => {
        if (!c.at) return null;
        const [x, y] = toScreen(c.at);
        if (x < -50 || y < -50 || x > size.value[0] + 50 || y > size.value[1] + 50) return null;
        const label = c.links.map((name) => (order.includes(name) ? String(order.indexOf(name)) : name)).join("·");
        return (
          <g key={c.links.join()} data-centre={c.links.join()} transform={`translate(${x.toFixed(1)} ${y.toFixed(1)})`}>
            <path d="M-5 0H5M0-5V5" />
            <text x="6" y="-5">
              {label}
              <title>{c.links.join(" and ")}</title>
            </text>
          </g>
        );
      })}
    </g>
  );
}

/** The present picks, the rubber band with its length and angle, and the place of the next pick. */
function Drawn(): JSX.Element | null {
  const list = picks.value;
  const next = hover.value;
  const last = list.at(-1);
  const drawing = tool.value !== "select" && tool.value !== "reshape";
  const [nx, ny] = next ? toScreen(next.at) : [0, 0];
  // `Poses` draws the pairs of places of the three poses; only an unfinished pair has a rubber band
  const band = tool.value !== "poses" ? list : list.length < 6 && list.length % 2 ? list.slice(-1) : [];
  const points = [...band.map((p) => p.at), ...(next && band.length ? [next.at] : [])].map(toScreen);
  const d = points.map((p, i) => `${i ? "L" : "M"}${p[0]} ${p[1]}`).join("");
  const angle = last && next ? (Math.atan2(next.at[1] - last.at[1], next.at[0] - last.at[0]) * 180) / Math.PI : 0;
  const cross = cursor.value && toScreen(cursor.value);
  return (
    <g class="rubber" aria-hidden="true">
      {points.length > 1 && <path class={current().open ? "area" : ""} d={d + (current().open && points.length > 2 ? "Z" : "")} />}
      {list.map((p, i) => {
        const [x, y] = toScreen(p.at);
        return <circle key={i} cx={x} cy={y} r="5" />;
      })}
      {drawing && next && <circle class={next.pin !== null ? "snap" : next.link ? "snap bar" : "spot"} cx={nx} cy={ny} r={next.pin !== null ? 11 : next.link ? 8 : 3.5} />}
      {band.length > 0 && last && next && apart(last.at, next.at) > 0 && (
        <text x={nx + 16} y={ny + 24}>
          {amount(apart(last.at, next.at), "m")}, {angle.toFixed(1)}°
        </text>
      )}
      {cross && <path class="cross" d={`M${cross[0] - 12} ${cross[1]}h24M${cross[0]} ${cross[1] - 12}v24`} />}
    </g>
  );
}

const TOOL_OF_KEY = new Map(TOOLS.map((t) => [t.key, t.id]));

/** Handles keys that work everywhere except in fields. */
export function shortcuts(e: KeyboardEvent): void {
  const field = (e.target as HTMLElement | null)?.closest?.("input,textarea,select,dialog");
  if ((e.ctrlKey || e.metaKey) && !e.altKey) {
    const k = e.key.toLowerCase();
    if (field && k !== "s" && k !== "o") return;
    if (k === "z") void edit(e.shiftKey ? "redo" : "undo");
    else if (k === "y") void edit("redo");
    else if (k === "s") document.getElementById("save")?.click();
    else if (k === "o") dialog.value = "open";
    else return;
    e.preventDefault();
    return;
  }
  if (field || e.altKey) return;
  const still = !cursor.value && tool.value === "select";
  if (e.key === " " && still && (e.target === document.body || (e.target as Element).id === "canvas")) {
    e.preventDefault();
    void play();
  } else if (e.key === "?") dialog.value = "help";
  else if (e.key === "Escape" && e.target === document.body) cancel();
  else {
    const hand = TOOL_OF_KEY.get(e.key.toLowerCase());
    if (hand) choose(hand);
  }
}
