//! Executes README.md, CONTRIBUTING.md and the book in docs/: every command of their `sh` blocks runs, every `toml`
//! block is parsed, and every command in running text names a subcommand and options that exist.
//!
//! The commands of a page run one block after the other in one folder that looks like the root of the repository. A
//! block that begins with `# file: NAME` or `// file: NAME` is written into that file and not run. A block
//! `sh,hardware` must fail because the haptic device is missing. Programs that would build the repository again are
//! replaced by scripts (see `stand_ins`), since `.ci/run` runs these programs themselves.
#![cfg(all(unix, feature = "view"))]

#[allow(dead_code, reason = "shared with the tests of the window")]
#[path = "../display/mod.rs"]
mod display;
#[path = "../../../capi/tests/ffi_help/mod.rs"]
mod ffi_help;
#[path = "../../../book/src/pages.rs"]
mod files;

use std::collections::HashMap;
use std::fmt::Write;
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::thread;
use std::time::Instant;

use display::Display;
use ffi_help::{library, root};
use pulldown_cmark::{CodeBlockKind, Event, Parser, Tag, TagEnd};

/// Files and folders of the repository that are linked into the folder in which a page's commands run.
const SEEN: [&str; 8] = ["assets", "examples", "docs", "crates", "src", "vk-tests", "Cargo.toml", "README.md"];
/// Number of rings, number of sectors, and radius (m) of the sphere that stands in for a mesh of the reader's own,
/// which the pages call `my-organ.obj` (coordinates in metres) and `my-organ.stl` (in millimetres).
const ORGAN: (u32, u32, f64) = (40, 50, 0.025);
/// Seconds after which a block is ended.
const PATIENCE: &str = "600";
/// Words that the message about a missing haptic device contains.
const NO_DEVICE: &str = "the haptic device is lost";

/// A block of code in a page.
struct Code {
    /// The words after the opening fence, such as `sh` or `sh,hardware`; empty for an indented block without fences.
    kind: String,
    text: String,
}

/// A page of Markdown.
struct Page {
    name: String,
    blocks: Vec<Code>,
    /// Code within running text.
    spans: Vec<String>,
}

fn page(file: &Path) -> Page {
    let text = fs::read_to_string(file).unwrap();
    let name = file.strip_prefix(root()).unwrap_or(file).display().to_string();
    let mut page = Page { name, blocks: Vec::new(), spans: Vec::new() };
    let mut open: Option<Code> = None;
    for event in Parser::new(&text) {
        match event {
            Event::Start(Tag::CodeBlock(kind)) => {
                let kind = match kind {
                    CodeBlockKind::Fenced(words) => words.to_string(),
                    CodeBlockKind::Indented => String::new(),
                };
                open = Some(Code { kind, text: String::new() });
            }
            Event::End(TagEnd::CodeBlock) => page.blocks.extend(open.take()),
            Event::Text(text) => open.iter_mut().for_each(|code| code.text.push_str(&text)),
            Event::Code(span) => page.spans.push(span.to_string()),
            _ => {}
        }
    }
    page
}

/// All pages of the repository.
fn pages() -> Vec<Page> {
    files::files(root()).unwrap().iter().map(|file| page(file)).collect()
}

impl Code {
    fn is(&self, kind: &str) -> bool {
        self.kind.split([',', ' ']).next() == Some(kind)
    }

    /// Name of the file into which the block is written, if the block's first line gives one.
    fn file(&self) -> Option<&str> {
        let first = self.text.lines().next()?;
        ["# file: ", "// file: "].iter().find_map(|start| first.strip_prefix(start)).map(str::trim)
    }
}

fn executable(file: &Path, text: &str) {
    fs::write(file, text).unwrap();
    fs::set_permissions(file, fs::Permissions::from_mode(0o755)).unwrap();
}

/// A sphere as the text of an OBJ file; `scale` is the number of the file's units of length in a metre.
fn organ(scale: f64) -> String {
    let (rings, sectors, radius) = ORGAN;
    let radius = radius * scale;
    let mut text = String::new();
    let at = |ring: u32, sector: u32| {
        let (polar, around) = (
            std::f64::consts::PI * f64::from(ring) / f64::from(rings),
            std::f64::consts::TAU * f64::from(sector) / f64::from(sectors),
        );
        [polar.sin() * around.cos(), polar.cos(), -polar.sin() * around.sin()].map(|x| x * radius)
    };
    for ring in 1..rings {
        for sector in 0..sectors {
            let [x, y, z] = at(ring, sector);
            writeln!(text, "v {x:.6} {y:.6} {z:.6}").unwrap();
        }
    }
    writeln!(text, "v 0 {radius} 0\nv 0 -{radius} 0").unwrap();
    let index = |ring: u32, sector: u32| (ring - 1) * sectors + sector % sectors + 1;
    let (top, bottom) = ((rings - 1) * sectors + 1, (rings - 1) * sectors + 2);
    for sector in 0..sectors {
        writeln!(text, "f {top} {} {}", index(1, sector), index(1, sector + 1)).unwrap();
        writeln!(text, "f {bottom} {} {}", index(rings - 1, sector + 1), index(rings - 1, sector)).unwrap();
        for ring in 1..rings - 1 {
            let [a, b] = [index(ring, sector), index(ring, sector + 1)];
            let [c, d] = [index(ring + 1, sector), index(ring + 1, sector + 1)];
            writeln!(text, "f {a} {c} {d}\nf {a} {d} {b}").unwrap();
        }
    }
    text
}

/// The triangles of an OBJ file as an STL file.
fn stl(obj: &str) -> String {
    let lines = |keyword: &'static str| obj.lines().filter_map(move |line| line.strip_prefix(keyword));
    let vertices: Vec<&str> = lines("v ").collect();
    let mut text = String::from("solid organ\n");
    for face in lines("f ") {
        let corners = face.split(' ').map(|corner| vertices[corner.parse::<usize>().unwrap() - 1]);
        let corners: String = corners.map(|corner| format!("vertex {corner}\n")).collect();
        writeln!(text, "facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet").unwrap();
    }
    text + "endsolid organ\n"
}

/// Writes scripts that stand in for programs that the commands call, into `bin`, which is first on the path, and into
/// `folder`:
/// - `palpate` is the program of this build; its subcommand `view` ends after a second, since nobody closes its window;
///   where a service of haptic devices runs on this machine, the program is not called with `--haptics haply`, since it
///   would move a device that nobody holds;
/// - `cargo run --release -- ..` calls `palpate`; of other calls of cargo, which would build the repository again, only
///   the names of tests and packages are checked;
/// - `python3` is a Python that has NumPy;
/// - `setup.sh` does nothing, and `install.sh` installs the files of this build;
/// - `sbatch` runs the tasks 1 and 2 of a job array, one after the other.
fn stand_ins(folder: &Path, bin: &Path) {
    let program = env!("CARGO_BIN_EXE_palpate");
    let repository = root().canonicalize().unwrap();
    let repository = repository.display();
    executable(
        &bin.join("palpate"),
        &format!(
            "#!/bin/bash\nif [ \"${{1-}}\" = view ]; then\n  case \" $* \" in *' --steps '*|*' --seconds '*) ;; *) set -- \"$@\" --seconds 1 ;; esac\nfi\n\
             case \" $* \" in *' --haptics haply '*) if (: < /dev/tcp/localhost/10001) 2> /dev/null; then \
             echo '{NO_DEVICE}' >&2; exit 4; fi ;; esac\n\
             exec '{program}' \"$@\"\n"
        ),
    );
    executable(
        &bin.join("cargo"),
        &format!(
            "#!/bin/bash\ncase \"$1 ${{2-}} ${{3-}}\" in\n  'run --release --') shift 3; exec palpate \"$@\" ;;\n  \
             'run --release -p') [ -d \"{repository}/crates/${{4#palpate-}}\" ] || {{ echo \"cargo: no package $4\" >&2; exit 1; }} ;;\n  \
             fmt*|test*|doc*|clippy*|build*|check*)\n    while [ $# -gt 0 ]; do\n      case $1 in\n        \
             --test) ls '{repository}'/{{tests,crates/*/tests}}/\"$2\"{{.rs,/main.rs}} 2>/dev/null | grep -q . || [ \"$2\" = vk-tests ] \
             || {{ echo \"cargo: no test $2\" >&2; exit 1; }} ;;\n        \
             -p) [ \"$2\" = palpate ] || [ -d \"{repository}/crates/${{2#palpate-}}\" ] || {{ echo \"cargo: no package $2\" >&2; exit 1; }} ;;\n      \
             esac\n      shift\n    done ;;\n  *) echo \"cargo $*: no stand-in for this call\" >&2; exit 1 ;;\nesac\n"
        ),
    );
    let has_numpy =
        |python: &&str| Command::new(python).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success());
    let python = ["python3", "/usr/bin/python3"].into_iter().find(has_numpy);
    let python = python.expect("no Python has NumPy; ./setup.sh --tests installs it");
    let python = Command::new("which").arg(python).output().unwrap().stdout;
    let python = String::from_utf8(python).unwrap();
    executable(&bin.join("python3"), &format!("#!/bin/bash\nexec '{}' \"$@\"\n", python.trim()));
    executable(
        &bin.join("sbatch"),
        "#!/bin/bash\nfor last; do :; done\nfor task in 1 2; do SLURM_ARRAY_TASK_ID=$task bash -euc \"$last\"; done\n",
    );
    executable(&folder.join("setup.sh"), "#!/bin/bash\n");
    let built = bin.join("built");
    fs::create_dir(&built).unwrap();
    for file in [PathBuf::from(program), library().join("libpalpate_capi.so"), library().join("libpalpate_capi.a")] {
        symlink(&file, built.join(file.file_name().unwrap())).unwrap();
    }
    let install = format!(
        "#!/bin/bash\nprefix=target/install\n[ \"${{1-}}\" = --prefix ] && prefix=$2\nmkdir -p \"$prefix\"\n\
         exec '{repository}/install.sh' --prefix \"$(realpath \"$prefix\")\" --built '{}'\n",
        built.display()
    );
    executable(&folder.join("install.sh"), &install);
}

/// Runs a page's `sh` blocks up to the first that goes wrong; the error tells this block and what it printed.
fn run(page: &Page, display: &Display, cache: &Path) -> Result<(), String> {
    let place = tempfile::tempdir().unwrap();
    let (folder, bin) = (place.path().join("palpate"), place.path().join("bin"));
    fs::create_dir(&folder).unwrap();
    fs::create_dir(&bin).unwrap();
    for name in SEEN {
        symlink(root().canonicalize().unwrap().join(name), folder.join(name)).unwrap();
    }
    fs::write(folder.join("my-organ.obj"), organ(1.0)).unwrap();
    fs::write(folder.join("my-organ.stl"), stl(&organ(1e3))).unwrap();
    stand_ins(&folder, &bin);
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    for block in &page.blocks {
        if let Some(file) = block.file() {
            let file = folder.join(file);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, &block.text).unwrap();
            continue;
        }
        if !block.is("sh") {
            continue;
        }
        let mut command = Command::new("timeout");
        command.args([PATIENCE, "bash", "-e", "-u", "-o", "pipefail", "-c", &block.text]).current_dir(&folder);
        command.env("PATH", &path).env("PALPATE_CACHE", cache).env("PYTHONDONTWRITEBYTECODE", "1");
        command.env("DISPLAY", display.name()).env_remove("WAYLAND_DISPLAY").env("XMODIFIERS", "@im=none");
        let done = command.output().unwrap();
        let said = [&done.stdout[..], &done.stderr[..]].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        let said = said.join("\n");
        let as_expected = match block.kind.contains("hardware") {
            true => !done.status.success() && said.contains(NO_DEVICE),
            false => done.status.success(),
        };
        if !as_expected {
            return Err(format!("{}: unexpected {} of:\n{}\n{said}", page.name, done.status, block.text));
        }
    }
    Ok(())
}

#[test]
#[ignore = "long: it runs every command of the book"]
fn lasting_commands_of_readme_and_book_succeed() {
    let (display, cache) = (Display::start(), tempfile::tempdir().unwrap());
    let only = std::env::var("PALPATE_PAGE").unwrap_or_default();
    let waiting = Mutex::new(pages().into_iter().filter(|page| page.name.contains(&only)));
    let failures = Mutex::new(Vec::new());
    let next = || waiting.lock().unwrap().next();
    let run_some = || {
        while let Some(page) = next() {
            let begun = Instant::now();
            let failure = run(&page, &display, cache.path()).err();
            println!("{:5.1} s for the page {}", begun.elapsed().as_secs_f64(), page.name);
            failures.lock().unwrap().extend(failure);
        }
    };
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().unwrap().get() {
            scope.spawn(run_some);
        }
    });
    let failures = failures.into_inner().unwrap();
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

/// The help text of a subcommand of `palpate`; `None` if the subcommand does not exist. `known` keeps the answers by
/// subcommand.
fn options(subcommand: &str, known: &mut HashMap<String, Option<String>>) -> Option<String> {
    let ask = || {
        let done = Command::new(env!("CARGO_BIN_EXE_palpate")).args([subcommand, "--help"]).output().unwrap();
        done.status.success().then(|| String::from_utf8(done.stdout).unwrap())
    };
    known.entry(subcommand.into()).or_insert_with(ask).clone()
}

/// What is wrong with a command line of `palpate`: a subcommand or an option that does not exist; `None` if nothing is.
fn unknown(command: &str, known: &mut HashMap<String, Option<String>>) -> Option<String> {
    let rest = command.strip_prefix("palpate ").or_else(|| command.strip_prefix("cargo run --release -- "))?;
    let mut words = rest.split_whitespace();
    let subcommand = words.next().filter(|word| word.starts_with(|c: char| c.is_ascii_lowercase()))?;
    let Some(help) = options(subcommand, known) else { return Some(format!("there is no `palpate {subcommand}`")) };
    let options = words.filter_map(|word| word.trim_matches(['[', ']']).strip_prefix("--"));
    let name = |option: &str| option.split(['=', '[', '`', ',', ']']).next().unwrap_or_default().to_owned();
    let known: Vec<&str> = help.split(|c: char| !c.is_ascii_alphanumeric() && c != '-').collect();
    options
        .map(name)
        .find(|option| !option.is_empty() && !known.contains(&format!("--{option}").as_str()))
        .map(|option| format!("`palpate {subcommand}` has no option --{option}"))
}

#[test]
fn code_of_readme_and_book_is_sound() {
    let mut known = HashMap::new();
    let mut problems = Vec::new();
    for page in pages() {
        let mut wrong = |what: String| problems.push(format!("{}: {what}", page.name));
        for block in &page.blocks {
            if block.is("toml") {
                if let Err(error) = block.text.parse::<toml::Table>() {
                    wrong(format!("this block is not TOML: {error}\n{}", block.text));
                }
            } else if ["c", "cpp", "python"].iter().any(|kind| block.is(kind))
                && block.file().is_none()
                // The tests of the Python package run these.
                && !(block.is("python") && block.text.contains("import palpate"))
            {
                wrong(format!("no command can use this block, since its first line names no file:\n{}", block.text));
            } else if !["sh", "text", "c", "cpp", "python", "rust", "csv", "json"].iter().any(|kind| block.is(kind)) {
                wrong(format!("a block of the unknown kind \"{}\":\n{}", block.kind, block.text));
            }
        }
        page.spans.iter().filter_map(|span| unknown(span, &mut known)).for_each(&mut wrong);
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
