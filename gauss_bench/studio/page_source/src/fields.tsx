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

/** A number with its unit. Enter or leaving the field sends it; Esc takes it back. An empty field is null where `empty` says what that means. */
export function NumberField({ label, value, unit, empty, send, children }: Numeric): JSX.Element {
  const [draft, setDraft] = useState<string | null>(null);
  const shown = value === null || value === undefined ? "" : String(Number(value.toPrecision(8)));
  const finish = (): void => {
    if (draft === null || draft === shown) return setDraft(null);
    const next = draft.trim() === "" ? null : Number(draft.replace(",", "."));
    setDraft(null);
    if (next === null ? empty === undefined : !Number.isFinite(next)) say(`${label} takes a number.`, "error");
    else void send(next);
  };
  return (
    <label class="field">
      <span>{label}</span>
      <span class="entry">
        <input
          type="text"
          inputMode="decimal"
          aria-label={label}
          value={draft ?? shown}
          placeholder={empty}
          onInput={(e) => setDraft(e.currentTarget.value)}
          onBlur={finish}
          onKeyDown={(e) => (e.key === "Enter" ? finish() : e.key === "Escape" && setDraft(null))}
        />
        {unit && <small>{unit}</small>}
        {children}
      </span>
    </label>
  );
}

export function TextField({ label, value, send }: { label: string; value: string; send: (value: string) => unknown }): JSX.Element {
  const [draft, setDraft] = useState<string | null>(null);
  const finish = (): void => {
    const next = draft?.trim();
    setDraft(null);
    if (next !== undefined && next !== value) void send(next);
  };
  return (
    <label class="field">
      <span>{label}</span>
      <span class="entry">
        <input
          type="text"
          value={draft ?? value}
          spellcheck={false}
          onInput={(e) => setDraft(e.currentTarget.value)}
          onBlur={finish}
          onKeyDown={(e) => (e.key === "Enter" ? finish() : e.key === "Escape" && setDraft(null))}
        />
      </span>
    </label>
  );
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
