// The dialogs: gallery and files, save, export and share, other assemblies, help.
import { signal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import { download } from "./download";
import { NumberField, hasRefused } from "./fields";
import { canFilm, film } from "./film";
import { Sign } from "./icons";
import type { Poses, Template } from "./protocol";
import { Recommend, Release } from "./runs";
import { LookLink } from "./share";
import { Sheet } from "./sheet";
import { attempt, dialog, dragged, edit, hello, open, said, say, scene, touring } from "./state";
import { TOOLS, choose, pictureScaled, tool } from "./tools";
import { ask } from "./socket";
import { fit, size, toWorld } from "./view";

const close = (): void => void (dialog.value = "");

async function opened(what: object, verb = "open"): Promise<void> {
  const reply = await open(what, verb);
  if (!reply) return;
  close();
  const lacking = (reply.left_out ?? []) as string[];
  if (lacking.length) say(`Brought in without what a linkage file has no word for: ${lacking.join("; ")}.`, "notice");
}

const drawings = signal<Record<string, string>>({});
let wanted: string[] = [];
let fetching = false;

/** Requests the drawings of cards one by one, so that the reply to a click waits for one drawing at most. */
async function fetchDrawings(): Promise<void> {
  if (fetching) return;
  fetching = true;
  for (let name = wanted.shift(); name !== undefined; name = wanted.shift()) {
    const reply = await ask("drawing", { name }).catch(() => null); // a card without a drawing still has its title
    drawings.value = { ...drawings.value, [name]: String(reply?.svg ?? "") };
  }
  fetching = false;
}

/** A card of the gallery with a linkage; its drawing is requested while the card is shown. */
function Card({ entry, go }: { entry: Template; go: () => unknown }): JSX.Element {
  const drawing = entry.drawing ?? drawings.value[entry.name] ?? "";
  useEffect(() => {
    if (drawing) return;
    wanted.push(entry.name);
    void fetchDrawings();
    return () => void (wanted = wanted.filter((name) => name !== entry.name));
  }, []);
  return (
    <li>
      <button type="button" onClick={() => void go()}>
        {drawing ? <img alt="" src={`data:image/svg+xml;charset=utf-8,${encodeURIComponent(drawing)}`} /> : <span class="blank" />}
        <b>{entry.name.replaceAll("_", " ")}</b>
        <small>{entry.title}</small>
      </button>
    </li>
  );
}

const KIND_WORDS: Record<string, string> = { "built-in": "Linkages of the suite", classic: "Classics" };

function Open(): JSX.Element {
  const known = hello.value;
  const [wanted, want] = useState("");
  useEffect(() => {
    void attempt("files").then((reply) => reply && hello.value && (hello.value = { ...hello.value, files: reply.files as string[], kept: reply.kept as string[] }));
  }, []);
  const fits = (t: Template): boolean => `${t.name} ${t.title} ${t.kind}`.toLowerCase().includes(wanted.toLowerCase());
  const built: Template[] = (known?.linkages ?? []).filter((name) => !known!.templates.some((t) => t.name === name)).map((name) => ({ name, title: "", kind: "" }));
  const kinds = [...new Set((known?.templates ?? []).map((t) => t.kind))];
  const read = async (file: File | undefined): Promise<void> => {
    if (!file) return;
    if (file.size > 1_048_576) return say(`${file.name} has more than 1 MiB, which no linkage file has.`, "error");
    const text = await file.text();
    await opened({ text, name: file.name }, /\.xml$|\.mjcf$/i.test(file.name) ? "import" : "open");
  };
  return (
    <Sheet title="Open" wide>
      <div class="row">
        <button type="button" class="quiet" onClick={() => void opened({}, "new")}>
          Empty drawing
        </button>
        <label class="quiet file">
          A file: linkage (TOML) or MuJoCo model (XML)
          <input type="file" accept=".toml,.xml,.mjcf" onChange={(e) => void read(e.currentTarget.files?.[0])} />
        </label>
        <input type="search" placeholder="Search" aria-label="Search templates" value={wanted} onInput={(e) => want(e.currentTarget.value)} />
      </div>
      {(known?.files ?? []).length > 0 && (
        <section>
          <h3>In the folder {known!.folder}</h3>
          <ul class="chips">
            {known!.files!.map((name) => (
              <li key={name}>
                <button type="button" class={known!.kept?.includes(name) ? "kept" : ""} onClick={() => void opened({ name })}>
                  {name}
                  {known!.kept?.includes(name) && <small>more is kept than was saved</small>}
                </button>
              </li>
            ))}
          </ul>
        </section>
      )}
      {kinds.map((kind) => {
        const list = known!.templates.filter((t) => t.kind === kind && fits(t));
        return list.length > 0 && (
          <section key={kind}>
            <h3>{KIND_WORDS[kind] ?? kind}</h3>
            <ul class="gallery">{list.map((t) => <Card key={t.name} entry={t} go={() => opened({ name: t.name }, "template")} />)}</ul>
          </section>
        );
      })}
      {built.some(fits) && (
        <section>
          <h3>Linkages of the suite</h3>
          <ul class="gallery">{built.filter(fits).map((t) => <Card key={t.name} entry={t} go={() => opened({ name: t.name })} />)}</ul>
        </section>
      )}
    </Sheet>
  );
}

function Save(): JSX.Element {
  const [path, setPath] = useState(`${scene.value?.name || "linkage"}.toml`);
  const [taken, setTaken] = useState(false);
  const write = async (replace: boolean): Promise<void> => {
    const reply = await edit("save", { path, ...(replace ? { replace: true } : {}) });
    if (reply) {
      const at = String(reply.path ?? scene.value?.path ?? path);
      say(`Saved as ${at}.`);
      close();
      return;
    }
    setTaken(said.value?.field === "replace");
  };
  return (
    <Sheet title="Save">
      <form
        method="dialog"
        onSubmit={(e) => {
          e.preventDefault();
          void write(taken);
        }}
      >
        <label class="field">
          <span>File, in the folder the studio was started in</span>
          <span class="entry">
            <input type="text" name="path" autofocus value={path} spellcheck={false} onInput={(e) => { setPath(e.currentTarget.value); setTaken(false); }} />
          </span>
        </label>
        <div class="row end">
          <button type="submit" class="strong">
            {taken ? "Replace the file" : "Save the file"}
          </button>
        </div>
      </form>
    </Sheet>
  );
}

const KINDS: [string, string, string][] = [
  ["toml", "Linkage file", "read by every command of the suite"],
  ["svg", "Drawing", "SVG"],
  ["csv", "Motion", "table, CSV"],
  ["gif", "Animation", "GIF"],
  ["webm", "Film", "as it is on show, WebM"],
  ["mujoco", "MuJoCo", "model"],
  ["pinocchio", "Pinocchio", "script"],
  ["exudyn", "Exudyn", "script"],
  ["casadi", "CasADi", "script"],
  ["c", "C", "source"],
];

function Export(): JSX.Element {
  const [link, setLink] = useState("");
  const [busy, setBusy] = useState("");
  const take = async (kind: string): Promise<void> => {
    setBusy(kind);
    if (kind === "webm") {
      const found = await film().catch((error: unknown) => say(String((error as Error).message ?? error), "error"));
      setBusy("");
      if (found) download(`${scene.value?.name || "linkage"}.webm`, found, "video/webm");
      return;
    }
    const reply = await attempt("export", { kind });
    setBusy("");
    if (!reply) return;
    const name = String(reply.name ?? `linkage.${kind}`);
    if (typeof reply.base64 === "string") download(name, Uint8Array.from(atob(reply.base64), (c) => c.charCodeAt(0)), "application/octet-stream");
    else download(name, String(reply.text ?? ""), "text/plain");
  };
  const share = async (): Promise<void> => {
    const reply = await attempt("share");
    if (!reply) return;
    const address = `${location.origin}${location.pathname}#${String(reply.fragment)}`;
    setLink(address);
    await navigator.clipboard?.writeText(address).catch(() => undefined);
  };
  return (
    <Sheet title="Share and export">
      <LookLink />
      <h3>A link to open in a studio</h3>
      <p class="note">The link contains the whole linkage, and nothing is sent to a server. To open it in another studio, append the part from the # sign on to the address of that studio.</p>
      <div class="row">
        <button type="button" class="strong" onClick={() => void share()}>
          Make a link
        </button>
        {link && <input type="text" readOnly value={link} aria-label="Link" onFocus={(e) => e.currentTarget.select()} />}
      </div>
      {link && <p class="note">{link.length} characters, copied.</p>}
      <h3>Download</h3>
      <ul class="kinds">
        {KINDS.filter(([kind]) => kind !== "webm" || canFilm).map(([kind, name, note]) => (
          <li key={kind}>
            <button type="button" disabled={busy !== ""} onClick={() => void take(kind)}>
              <b>{name}</b>
              <small>{busy !== kind ? note : kind === "webm" ? "plays once, and is recorded …" : "writing …"}</small>
            </button>
          </li>
        ))}
      </ul>
    </Sheet>
  );
}

function Branches(): JSX.Element {
  const [list, setList] = useState<{ name: string; poses: Poses }[] | null>(null);
  useEffect(() => {
    void (async () => {
      const reply = await attempt("branches");
      if (reply) setList((reply as unknown as { branches: { name: string; poses: Poses }[] }).branches ?? []);
    })();
    return () => void (dragged.value = null);
  }, []);
  return (
    <Sheet title="Other assemblies">
      <p class="note">Other assemblies of the same links at the same angle of the input. Point at one to see it, and click to choose it.</p>
      {!list && said.value?.level !== "error" && <p class="note">Looking for them …</p>}
      {list?.length === 0 && <p class="note">There is no other assembly.</p>}
      <ul class="chips">
        {list?.map((branch, index) => (
          <li key={index}>
            <button
              type="button"
              onPointerEnter={() => (dragged.value = branch.poses)}
              onFocus={() => (dragged.value = branch.poses)}
              onPointerLeave={() => (dragged.value = null)}
              onClick={() => void edit("branch", { index }).then(close)}
            >
              {branch.name}
            </button>
          </li>
        ))}
      </ul>
    </Sheet>
  );
}

const KEYS: [string, string][] = [
  ["Arrows", "move the cross; if a pin is selected, drag the pin (Select) or place it elsewhere (Reshape); with Shift, move five steps"],
  ["Enter", "click at the cross; with Shift, add to the selection; end a link of three or more corners"],
  ["Esc", "end a drag, leave the tool, select nothing"],
  ["Space", "play and pause"],
  ["Del", "delete the selected parts"],
  ["Ctrl+Z, Ctrl+Shift+Z", "undo, redo"],
  ["Ctrl+S, Ctrl+O", "save, open"],
  ["+, -, 0", "zoom in, out, fit"],
  ["Alt", "hold it to ignore the grid"],
  ["Shift", "while dragging a joint: change lengths instead of moving"],
];

function Help(): JSX.Element {
  return (
    <Sheet title="Help">
      <dl class="help">
        {TOOLS.map((t) => (
          <>
            <dt key={t.id}>
              <Sign of={t.id} /> {t.name} <kbd>{t.key.toUpperCase()}</kbd>
            </dt>
            <dd>{t.help}</dd>
          </>
        ))}
      </dl>
      <h3>Keys</h3>
      <dl class="keys">
        {KEYS.map(([k, text]) => (
          <>
            <dt key={k}>
              <kbd>{k}</kbd>
            </dt>
            <dd>{text}</dd>
          </>
        ))}
      </dl>
      <h3>What is not saved</h3>
      <p class="note">
        The studio keeps unsaved changes on this machine. If the studio or the browser ends without saving, the changes are offered again: those of a file when
        the file is opened, those of a new drawing when a studio is started in the same folder.
      </p>
      <div class="row">
        <button type="button" class="quiet" onClick={() => { close(); touring.value = 0; }}>
          Take the tour
        </button>
        <small class="note">gauss_bench {hello.value?.version}. Positions, speeds and forces are computed by the suite, not in this page.</small>
      </div>
    </Sheet>
  );
}


/** The tool for a picture: reads the picture, fits it to the window, and scales it by two points and their distance. */
export function PictureBar(): JSX.Element | null {
  const [pair, setPair] = useState<[[number, number], [number, number]] | null>(null);
  const [metres, setMetres] = useState<number | null>(null);
  if (tool.value !== "picture") return null;
  const read = (file: File | undefined): void => {
    if (!file) return;
    if (file.size > 1_300_000) return say("The picture has more than 1.3 MB: choose a smaller one.", "error");
    const reader = new FileReader();
    reader.onload = () => {
      const data = String(reader.result);
      const image = new Image();
      image.onload = () => {
        const [w, h] = size.value;
        const [x0, y0] = toWorld([w * 0.1, h * 0.9]);
        const [x1] = toWorld([w * 0.9, 0]);
        const width = x1 - x0;
        void edit("picture", { picture: { url: data, at: [x0, y0], width, height: (width * image.naturalHeight) / image.naturalWidth } });
      };
      image.onerror = () => say(`${file.name} is no picture that a browser shows.`, "error");
      image.src = data;
    };
    reader.readAsDataURL(file);
  };
  pictureScaled.value = (a, b) => setPair([a, b]);
  const picture = scene.value?.picture;
  const apply = async (): Promise<void> => {
    if (!picture || !pair || hasRefused(".picturebar")) return;
    if (!(metres! > 0)) return say("The distance of the two points must be positive.", "error");
    const [a, b] = pair;
    const f = metres! / Math.hypot(b[0] - a[0], b[1] - a[1]);
    const at = [a[0] + f * (picture.at[0] - a[0]), a[1] + f * (picture.at[1] - a[1])];
    await edit("picture", { picture: { at, width: picture.width * f, height: picture.height * f } }); // without a URL the server changes place and size of the present picture
    setPair(null);
    setMetres(null);
    choose("select");
    fit(scene.value, scene.value?.picture ? [scene.value.picture.at, [scene.value.picture.at[0] + scene.value.picture.width, scene.value.picture.at[1] + scene.value.picture.height]] : []);
  };
  return (
    <div class="picturebar">
      <label class="quiet file">
        {picture ? "Another picture" : "Choose a picture"}
        <input type="file" accept="image/png,image/jpeg,image/webp,image/gif" onChange={(e) => read(e.currentTarget.files?.[0])} />
      </label>
      {picture && (
        <button type="button" class="quiet" onClick={() => void edit("picture", { picture: null })}>
          Remove it
        </button>
      )}
      {pair && (
        <form
          onSubmit={(e) => {
            e.preventDefault();
            void apply();
          }}
        >
          <NumberField label="Distance of the two points" unit="m" value={metres} empty="" send={setMetres} />
          <button type="submit" class="strong">
            Scale
          </button>
        </form>
      )}
    </div>
  );
}

export function Dialogs(): JSX.Element | null {
  switch (dialog.value) {
    case "open":
    case "gallery":
      return <Open />;
    case "save":
      return <Save />;
    case "export":
    case "share":
      return <Export />;
    case "branches":
      return <Branches />;
    case "release":
      return <Release />;
    case "recommend":
      return <Recommend />;
    case "help":
      return <Help />;
    default:
      return null;
  }
}
