// A link to a static page that draws the linkage and its motion from its address, for readers without an installation.
import type { JSX } from "preact";
import { useState } from "preact/hooks";
import { said, attempt } from "./state";

interface Made {
  page: string;
  fragment: string;
  poses: number;
  note: string | null;
}

/** An address to copy; it is also selected, for browsers that do not permit writing to the clipboard. */
function Address({ name, value }: { name: string; value: string }): JSX.Element {
  const [copied, setCopied] = useState(false);
  const copy = async (field: HTMLInputElement): Promise<void> => {
    field.select();
    setCopied((await navigator.clipboard?.writeText(value).then(() => true, () => false)) ?? false);
  };
  return (
    <label class="field">
      <span>{name}</span>
      <span class="row address">
        <input type="text" readOnly value={value} onFocus={(e) => e.currentTarget.select()} />
        <button type="button" class="quiet" onClick={(e) => void copy(e.currentTarget.parentElement!.querySelector("input")!)}>
          {copied ? "Copied" : "Copy"}
        </button>
      </span>
    </label>
  );
}

export function LookLink(): JSX.Element {
  const [made, setMade] = useState<Made | null>(null);
  const [busy, setBusy] = useState(false);
  const [fault, setFault] = useState("");
  const make = async (): Promise<void> => {
    setBusy(true);
    const reply = await attempt("view");
    setBusy(false);
    setMade(reply as unknown as Made | null);
    setFault(reply ? "" : (said.value?.text ?? ""));
  };
  const address = made && `${location.origin}/${made.page}#${made.fragment}`;
  return (
    <section class="look">
      <h3>A link to look at</h3>
      <p class="note">The link opens a page that draws the linkage and its motion, and shows the file. It needs no installation: the address contains everything.</p>
      <div class="row">
        <button type="button" class="strong" disabled={busy} onClick={() => void make()}>
          {busy ? "Making the link …" : "Make a link to look at"}
        </button>
        {address && (
          <a href={address} target="_blank" rel="noopener noreferrer">
            Open it
          </a>
        )}
      </div>
      {fault && <p class="refusal" role="alert">{fault}</p>}
      {made && address && (
        <>
          <Address name="For this machine, while the studio runs" value={address} />
          <Address name="For others: put it behind the address of a published site" value={`${made.page}#${made.fragment}`} />
          <p class="note">
            {made.fragment.length} characters, with {made.poses === 1 ? "the drawing alone" : `${made.poses} poses`}
            {made.note ? `: ${made.note}` : "."} Every site that <code>gauss-bench report</code> writes has the page {made.page}.
          </p>
        </>
      )}
    </section>
  );
}
