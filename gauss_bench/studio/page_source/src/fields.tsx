// Fields for one value of the file each, which is sent when the user has finished typing.
import type { ComponentChildren, JSX } from "preact";
import { useId, useState } from "preact/hooks";
import { Sign } from "./icons";
import { amount, inShown, read, refusal, shownUnit } from "./units";

interface Numeric {
  label: string;
  value: number | null | undefined;
  unit?: string; // unit of the value in the file
  empty?: string;
  send: (value: number | null) => unknown;
  children?: ComponentChildren;
}

interface Entered {
  label: string;
  name?: string; // name with unit for screen readers
  shown: string;
  finish: (draft: string) => string | void; // returns the reason if the draft is refused
  children?: ComponentChildren;
  input?: { inputMode?: "text"; placeholder?: string | undefined; spellcheck?: boolean };
}

/** A text field that shows `shown` until the user types. Enter or leaving the field finishes the draft; Esc discards it. */
function Entry({ label, name, shown, finish, children, input }: Entered): JSX.Element {
  const [draft, setDraft] = useState<string | null>(null);
  const [fault, setFault] = useState("");
  const id = useId();
  const type = (text: string | null): void => {
    setDraft(text);
    setFault("");
  };
  const done = (): void => {
    if (draft === null) return;
    const refused = draft === shown ? "" : finish(draft);
    if (refused) setFault(refused); // the draft stays, so that the user can correct it
    else type(null);
  };
  return (
    <label class="field">
      <span>{label}</span>
      <span class="entry">
        <input
          type="text"
          aria-label={name ?? label}
          aria-invalid={fault !== ""}
          aria-describedby={fault ? id : undefined}
          value={draft ?? shown}
          onInput={(e) => type(e.currentTarget.value)}
          onBlur={done}
          onKeyDown={(e) => (e.key === "Enter" ? done() : e.key === "Escape" && type(null))}
          {...input}
        />
        {children}
      </span>
      {fault && (
        <span class="refusal" id={id} role="alert">
          {fault}
        </span>
      )}
    </label>
  );
}

/** Whether a field inside an element has a refused draft; callers then do not use the other fields either. */
export const hasRefused = (under: string): boolean => document.querySelector(`${under} [aria-invalid=true]`) !== null;

/** A field for a quantity with its unit. If `empty` is given, an empty field has the value null. */
export function NumberField({ label, value, unit = "", empty, send, children }: Numeric): JSX.Element {
  const shown = value === null || value === undefined ? "" : String(Number(inShown(value, unit).toPrecision(8)));
  const finish = (draft: string): string | void => {
    const blank = draft.trim() === "";
    const next = blank ? null : read(draft, unit);
    if (next === null && !(blank && empty !== undefined)) return blank ? `${label} needs a value.` : refusal(draft, unit);
    void send(next);
  };
  const own = shownUnit(unit);
  return (
    <Entry label={label} name={own ? `${label}, ${own}` : label} shown={shown} finish={finish} input={{ inputMode: "text", placeholder: empty }}>
      {own && <small>{own}</small>}
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
      {amount(value, unit)}
    </b>
  </p>
);
