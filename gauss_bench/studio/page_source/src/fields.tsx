// Fields that hold one value of the file each: shown as it stands, sent when the user has finished.
import type { ComponentChildren, JSX } from "preact";
import { useState } from "preact/hooks";
import { figure } from "./geometry";
import { Sign } from "./icons";
import { say } from "./state";

interface Numeric {
  label: string;
  value: number | null | undefined;
  unit?: string;
  empty?: string;
  send: (value: number | null) => unknown;
  children?: ComponentChildren;
}

interface Entered {
  label: string;
  shown: string;
  finish: (draft: string) => void;
  children?: ComponentChildren;
  input?: { inputMode?: "decimal"; placeholder?: string | undefined; spellcheck?: boolean };
}

/** What stands there until somebody types. Enter or leaving the field finishes what was typed; Esc takes it back. */
function Entry({ label, shown, finish, children, input }: Entered): JSX.Element {
  const [draft, setDraft] = useState<string | null>(null);
  const done = (): void => {
    setDraft(null);
    if (draft !== null && draft !== shown) finish(draft);
  };
  return (
    <label class="field">
      <span>{label}</span>
      <span class="entry">
        <input
          type="text"
          aria-label={label}
          value={draft ?? shown}
          onInput={(e) => setDraft(e.currentTarget.value)}
          onBlur={done}
          onKeyDown={(e) => (e.key === "Enter" ? done() : e.key === "Escape" && setDraft(null))}
          {...input}
        />
        {children}
      </span>
    </label>
  );
}

/** A number with its unit. An empty field is null where `empty` says what that means. */
export function NumberField({ label, value, unit, empty, send, children }: Numeric): JSX.Element {
  const shown = value === null || value === undefined ? "" : String(Number(value.toPrecision(8)));
  const finish = (draft: string): void => {
    const next = draft.trim() === "" ? null : Number(draft.replace(",", "."));
    if (next === null ? empty === undefined : !Number.isFinite(next)) say(`${label} takes a number.`, "error");
    else void send(next);
  };
  return (
    <Entry label={label} shown={shown} finish={finish} input={{ inputMode: "decimal", placeholder: empty }}>
      {unit && <small>{unit}</small>}
      {children}
    </Entry>
  );
}

export function TextField({ label, value, send }: { label: string; value: string; send: (value: string) => unknown }): JSX.Element {
  const finish = (draft: string): void => {
    const next = draft.trim();
    if (next !== value) void send(next);
  };
  return <Entry label={label} shown={value} finish={finish} input={{ spellcheck: false }} />;
}

export const Lock = ({ of, on, set }: { of: string; on: boolean; set: (on: boolean) => unknown }): JSX.Element => (
  <button type="button" class="lock" aria-pressed={on} aria-label={`Lock ${of}`} title={on ? `${of} is locked: a drag keeps it` : `Lock ${of}: a drag keeps it`} onClick={() => void set(!on)}>
    <Sign of={on ? "lock" : "unlock"} />
  </button>
);

export const Check = ({ label, on, set }: { label: string; on: boolean; set: (on: boolean) => unknown }): JSX.Element => (
  <label class="check">
    <input type="checkbox" checked={on} onChange={(e) => void set(e.currentTarget.checked)} />
    <span>{label}</span>
  </label>
);

export const Read = ({ label, value, unit = "" }: { label: string; value: number | null; unit?: string }): JSX.Element => (
  <p class="read">
    <span>{label}</span>
    <b>
      {figure(value)} {unit}
    </b>
  </p>
);
