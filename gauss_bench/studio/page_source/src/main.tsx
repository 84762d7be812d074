// The page: its layout and its start.
import { render } from "preact";
import type { JSX } from "preact";
import { Canvas, shortcuts } from "./canvas";
import { Dialogs, PictureBar } from "./dialogs";
import { PosesBar } from "./poses";
import { Properties, show } from "./properties";
import { hear } from "./runs";
import { dialog, drawn, hello, open, placed, recover, said, scene, start, touring } from "./state";
import { Timeline } from "./timeline";
import { choose, picks, tool } from "./tools";
import { Moving, Prompt, Tools, Top, ViewSwitches, paint } from "./top";
import { Tour, begin, firstRun } from "./tour";
import { retold } from "./units";
import { toScreen, size } from "./view";
import type { Problem, XY } from "./protocol";
import "./studio.css";

/** Returns the place of a problem in pixels: that of the first drawn part that the problem names, or null. */
function whereabouts(problem: Problem): XY | null {
  const now = placed.value!;
  for (const id of problem.where) {
    const [kind, name] = [id.slice(0, id.indexOf(".")), id.slice(id.indexOf(".") + 1)];
    const pin = kind === "pins" && now.scene.pins.find((p) => p.id === name);
    if (pin) return toScreen(now.pin(pin));
    const slide = kind === "slides" && now.scene.slides.find((s) => s.id === name);
    if (slide) return toScreen(now.slide(slide).block);
    const force = kind === "forces" && now.scene.forces.find((f) => f.id === name);
    if (force && force.at[0]) return toScreen(now.force(force)[0]!);
    const link = kind === "links" ? now.link(name) : undefined;
    const points = link ? now.points(link).map(([, p]) => p) : [];
    if (points.length) return toScreen([points.reduce((s, p) => s + p[0], 0) / points.length, points.reduce((s, p) => s + p[1], 0) / points.length]);
  }
  return null;
}

/** The text of the first problem, beside the part that it concerns. */
function InPlace(): JSX.Element | null {
  const list = drawn.value?.problems ?? [];
  const problem = list.find((p) => p.level === "error") ?? list.find((p) => p.level === "warning");
  if (!problem || !placed.value || picks.value.length || touring.value >= 0) return null;
  const at = whereabouts(problem);
  const [w, h] = size.value;
  const left = Math.max(8, Math.min(w - 268, (at?.[0] ?? w / 2) + 18));
  const top = Math.max(8, Math.min(h - 120, (at?.[1] ?? 40) + 22));
  return (
    <button type="button" class={`inplace ${problem.level}`} style={{ left: `${left}px`, top: `${top}px` }} onClick={() => show(problem)}>
      <span>{retold(problem.text)}</span>
    </button>
  );
}

function Empty(): JSX.Element | null {
  const now = scene.value;
  if (!now) return <p class="opening">Opening …</p>;
  if (now.links.length || now.pins.length || tool.value !== "select" || touring.value >= 0) return null;
  const first = hello.value?.templates.find((t) => /crank_rocker|four_bar/.test(t.name)) ?? hello.value?.templates[0];
  return (
    <div class="empty">
      <h2>Draw a linkage</h2>
      <p>Set two ground pivots, join them with bars, and drag.</p>
      <div class="row">
        <button type="button" class="strong" onClick={() => choose("ground")}>
          Start with a pivot
        </button>
        <button type="button" class="quiet" onClick={() => (dialog.value = "open")}>
          Choose a template
        </button>
        {first && (
          <button type="button" class="quiet" onClick={() => void begin(first.name)}>
            Show me a four-bar
          </button>
        )}
      </div>
    </div>
  );
}

/** The offer to restore unsaved changes that an ended server has kept, of the open drawing or of a file of the folder. */
function Recovered(): JSX.Element | null {
  const known = hello.value;
  const other = scene.value?.path || scene.value?.links.length ? undefined : known?.kept?.[0];
  if (!(known?.recovered || other) || touring.value >= 0) return null;
  return (
    <div class="picturebar" role="region" aria-label="Kept">
      <p>What was drawn {known?.recovered ? "here before" : `in ${other}`} and not saved is kept.</p>
      {known?.recovered ? (
        <>
          <button type="button" class="strong" onClick={() => void recover(true)}>
            Recover it
          </button>
          <button type="button" class="quiet" onClick={() => void recover(false)}>
            Let it go
          </button>
        </>
      ) : (
        <button type="button" class="strong" onClick={() => void open({ name: other })}>
          Open {other}
        </button>
      )}
    </div>
  );
}

function Page(): JSX.Element {
  return (
    <>
      <Top />
      <Tools />
      <main>
        <Canvas />
        <p id="canvas-help" class="hidden">
          Choose a tool by its letter. Arrow keys move a cross, Enter clicks with it; the parts of the linkage are listed under Properties.
        </p>
        <Moving />
        <InPlace />
        <Empty />
        <ViewSwitches />
        <PictureBar />
        <PosesBar />
        <Recovered />
        <Prompt />
      </main>
      <Properties />
      <Timeline />
      <Dialogs />
      <Tour />
    </>
  );
}

paint();
addEventListener("keydown", shortcuts);
addEventListener("error", () => (said.value = { text: "The page has a fault. The server still has the linkage: load the page again.", level: "error" }));
const root = document.getElementById("studio")!;
root.replaceChildren();
render(<Page />, root);
firstRun();
start(hear);
