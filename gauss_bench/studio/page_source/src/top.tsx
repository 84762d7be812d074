// The bar above the drawing: files, undo, name and state of the linkage; and the switches of the view.
import { signal } from "@preact/signals";
import type { JSX } from "preact";
import { names } from "./canvas";
import { download } from "./download";
import { Sign } from "./icons";
import { connected } from "./socket";
import { copy, dialog, drawn, edit, ghost, lined, moving, said, scene, sheet, show } from "./state";
import { TOOLS, choose, current, finish, picks, posed, tool } from "./tools";
import { LENGTHS, length, measureIn, retold } from "./units";
import type { Length } from "./units";
import { zoom } from "./view";

type Theme = "light" | "dark" | "";
export const theme = signal<Theme>((localStorage.getItem("studio.theme") as Theme | null) ?? "");

export function paint(): void {
  if (theme.value) document.documentElement.dataset.theme = theme.value;
  else delete document.documentElement.dataset.theme;
}
const dark = (): boolean => (theme.value || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";

function turn(): void {
  theme.value = dark() ? "light" : "dark";
  localStorage.setItem("studio.theme", theme.value);
  paint();
}

/** Saves the drawing to its file; opens the dialog Save if the drawing has no file, or if saving needs a confirmation. */
async function save(): Promise<void> {
  if (!scene.value?.path || (!(await edit("save")) && said.value?.field === "replace")) dialog.value = "save";
}

const Button = ({ sign, name, hint, go, off, wide }: { sign: string; name: string; hint?: string; go: () => unknown; off?: boolean; wide?: boolean }): JSX.Element => (
  <button type="button" id={name === "Save" ? "save" : undefined} class={wide ? "quiet labelled" : "icon"} aria-label={name} title={hint ?? name} disabled={off} onClick={() => void go()}>
    <Sign of={sign} />
    {wide && <span>{name}</span>}
  </button>
);

export function Top(): JSX.Element {
  const now = drawn.value;
  const status = now?.status;
  const wrong = now?.problems.filter((p) => p.level === "error").length ?? 0;
  const count = (n: number, word: string): string => `${n} ${word}${n === 1 ? "" : "s"}`;
  return (
    <header class="top">
      <p class="brand">
        gauss<span>_bench</span> <small>studio</small>
      </p>
      <div class="group" role="group" aria-label="File">
        <Button sign="open" name="Open" hint="Open a template, a linkage or a file (Ctrl+O)" wide go={() => (dialog.value = "open")} />
        <Button sign="save" name="Save" hint="Save the linkage file (Ctrl+S)" wide go={save} />
        <Button sign="share" name="Share" hint="Export, or a link that carries the linkage" wide go={() => (dialog.value = "export")} />
      </div>
      <div class="group" role="group" aria-label="History">
        <Button sign="undo" name="Undo" hint="Undo (Ctrl+Z)" off={!now?.can_undo} go={() => edit("undo")} />
        <Button sign="redo" name="Redo" hint="Redo (Ctrl+Shift+Z)" off={!now?.can_redo} go={() => edit("redo")} />
      </div>
      <h1 class="document" title={now?.path ?? "not saved yet"}>
        {now?.name ?? ""}
        {now?.unsaved && (
          <span class="unsaved" title="Changed since it was saved">
            <span class="hidden">unsaved</span>
          </span>
        )}
      </h1>
      {status && now.links.length > 0 && (
        <ul class="status" data-testid="status" aria-label="State of the linkage">
          <li title="Degrees of freedom">
            <b data-testid="dof">{status.dof ?? "–"}</b> <abbr title="degrees of freedom">DOF</abbr>
          </li>
          <li title="Independent loops">
            <b data-testid="loop-count">{status.loops}</b> {status.loops === 1 ? "loop" : "loops"}
          </li>
          {(status.redundant ?? 0) > 0 && (
            <li class="doubtful" title="Redundant constraints">
              <b>{status.redundant}</b> redundant
            </li>
          )}
          <li class={status.assembles && !wrong ? "good" : "bad"}>
            {status.assembles && !wrong ? "assembles" : (
              <button type="button" onClick={() => { sheet.value = "properties"; }}>
                {wrong ? count(wrong, "problem") : "does not assemble"}
              </button>
            )}
          </li>
        </ul>
      )}
      <div class="group end" role="group" aria-label="More">
        <Button sign="help" name="Help" hint="Help (?)" go={() => (dialog.value = "help")} />
        <Button sign="sun" name={dark() ? "Light theme" : "Dark theme"} go={turn} />
        <button type="button" class="icon narrow" aria-label="Properties" aria-expanded={sheet.value === "properties"} onClick={() => (sheet.value = sheet.value === "properties" ? "" : "properties")}>
          <Sign of="panel" />
          {wrong > 0 && <span class="count">{wrong}</span>}
        </button>
      </div>
      {connected.value === "gone" && (
        <div class="gone" role="alert">
          The server has gone. Start it again in the same folder and open the address that it prints: what was drawn here is kept, and offered there.
          {copy.value && (
            <button type="button" class="quiet" onClick={() => download(`${now?.name || "linkage"}.toml`, copy.value, "text/plain")}>
              Download a copy
            </button>
          )}
        </div>
      )}
    </header>
  );
}

export function Tools(): JSX.Element {
  return (
    <nav class="tools" aria-label="Tools">
      {TOOLS.map((t) => (
        <button key={t.id} type="button" aria-label={t.name} aria-pressed={tool.value === t.id} aria-keyshortcuts={t.key} title={`${t.name} (${t.key.toUpperCase()})\n${t.help}`} onClick={() => choose(t.id)}>
          <Sign of={t.id} />
          <span aria-hidden="true">{t.name}</span>
        </button>
      ))}
    </nav>
  );
}

/** Switches of the view, in a corner of the drawing. */
export function ViewSwitches(): JSX.Element {
  return (
    <div class="switches" role="group" aria-label="View">
      <Button sign="plus" name="Zoom in" hint="Zoom in (+)" go={() => zoom(1.25)} />
      <Button sign="minus" name="Zoom out" hint="Zoom out (-)" go={() => zoom(0.8)} />
      <Button sign="fit" name="Fit" hint="Fit the linkage into the window (0)" go={show} />
      <button type="button" class="icon" aria-label="Snap to the grid" aria-pressed={lined.value} title="Snap to the grid (hold Alt to leave it)" onClick={() => (lined.value = !lined.value)}>
        <Sign of="magnet" />
      </button>
      <button type="button" class="icon" aria-label="Names" aria-pressed={names.value} title="Show names" onClick={() => (names.value = !names.value)}>
        <Sign of="tag" />
      </button>
      <select class="unit" aria-label="Unit of lengths" title="Unit in which lengths are shown; a field accepts 12 mm, 0.5 in or 1.2 m with any unit" value={length.value} onChange={(e) => measureIn(e.currentTarget.value as Length)}>
        {LENGTHS.map((unit) => (
          <option key={unit}>{unit}</option>
        ))}
      </select>
    </div>
  );
}

/** The next request of the chosen tool, or the last message; screen readers read it aloud. */
export function Prompt(): JSX.Element {
  const hand = current();
  const ask = posed.value ? "" : hand.asks[Math.min(picks.value.length, hand.asks.length - 1)];
  const word = said.value;
  const quiet = tool.value === "select" && !scene.value?.links.length ? "" : hand.id === "reshape" ? hand.help : "";
  const text = word ? retold(word.text) : (ask ?? quiet);
  return (
    <div class={`prompt${word?.level === "error" ? " refused" : ""}${text ? "" : " empty"}`}>
      <p role="status" aria-live="polite" data-testid="said">
        {text}
      </p>
      {word && (
        <button type="button" class="icon" aria-label="Dismiss" onClick={() => (said.value = null)}>
          <Sign of="close" />
        </button>
      )}
      {hand.open && picks.value.length > 2 && !word && (
        <button type="button" class="done" onClick={() => finish()}>
          Done
        </button>
      )}
    </div>
  );
}

export const Moving = (): JSX.Element | null => (moving.value ? <p class="badge">Showing the motion{ghost.value ? `; dashed: ${ghost.value.engine}` : ""}</p> : null);
