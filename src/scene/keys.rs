//! TOML tables of a scene (the bodies, the tool and the settings of a simulation) with their position in the file:
//! every key and value has its dotted path and its line, so that an error begins with the place `scene.toml:12:` and
//! the path `body.head.material.young`. `load.rs` reads scenes through this module, both from TOML text and from tables
//! that a program made, which have no lines.
//!
//! serde's derive is not used: it reports unknown keys without their table, and values out of range without their line.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::check::{self, Check, Problem};
use super::meshes::Meshes;
use super::reference::TableKeys;
use crate::{Error, Result, files};

/// Similarity (Jaro-Winkler, 0 to 1) above which a known key is suggested in place of an unknown one.
const LIKENESS: f64 = 0.7;

/// A TOML value, and the byte offset at which it begins in the text that it was read from, if there is a text.
pub struct Node {
    kind: Kind,
    offset: Option<usize>,
}

enum Kind {
    Text(String),
    /// The integer as it was written, and its value if that fits into 64 bits.
    Integer(String, Option<i64>),
    /// The value; `None` if the text cannot be read as a number.
    Float(Option<f64>),
    Truth(bool),
    Array(Vec<Node>),
    Table(Entries),
    /// A date, which is not valid in a scene.
    Other,
}

/// The entries of a table in their order: key, byte offset of the key, value.
type Entries = Vec<(String, Option<usize>, Node)>;

impl Kind {
    /// Name of the type in TOML.
    fn name(&self) -> &'static str {
        match self {
            Kind::Text(_) => "string",
            Kind::Integer(..) => "integer",
            Kind::Float(_) => "float",
            Kind::Truth(_) => "boolean",
            Kind::Array(_) => "array",
            Kind::Table(_) => "table",
            Kind::Other => "datetime",
        }
    }
}

impl From<&Spanned<DeValue<'_>>> for Node {
    fn from(value: &Spanned<DeValue>) -> Node {
        let kind = match value.get_ref() {
            DeValue::String(text) => Kind::Text(text.to_string()),
            DeValue::Integer(integer) => {
                let parsed = i64::from_str_radix(integer.as_str(), integer.radix()).ok();
                Kind::Integer(integer.to_string(), parsed)
            }
            DeValue::Float(float) => Kind::Float(float.as_str().parse().ok()),
            DeValue::Boolean(truth) => Kind::Truth(*truth),
            DeValue::Array(array) => Kind::Array(array.iter().map(Node::from).collect()),
            DeValue::Table(table) => Kind::Table(entries(table)),
            DeValue::Datetime(_) => Kind::Other,
        };
        Node { kind, offset: Some(value.span().start) }
    }
}

fn entries(table: &DeTable) -> Entries {
    let entry = |(key, value): (&Spanned<std::borrow::Cow<str>>, &Spanned<DeValue>)| {
        (key.get_ref().to_string(), Some(key.span().start), Node::from(value))
    };
    table.iter().map(entry).collect()
}

impl From<&toml::Value> for Node {
    fn from(value: &toml::Value) -> Node {
        let kind = match value {
            toml::Value::String(text) => Kind::Text(text.clone()),
            toml::Value::Integer(integer) => Kind::Integer(integer.to_string(), Some(*integer)),
            toml::Value::Float(float) => Kind::Float(Some(*float)),
            toml::Value::Boolean(truth) => Kind::Truth(*truth),
            toml::Value::Array(array) => Kind::Array(array.iter().map(Node::from).collect()),
            toml::Value::Table(table) => return Node::from(table),
            toml::Value::Datetime(_) => Kind::Other,
        };
        Node { kind, offset: None }
    }
}

impl From<&toml::Table> for Node {
    fn from(table: &toml::Table) -> Node {
        let entry = |(key, value): (&String, &toml::Value)| (key.clone(), None, Node::from(value));
        Node { kind: Kind::Table(table.iter().map(entry).collect()), offset: None }
    }
}

/// The text that tables are read from; byte offsets in it are converted to line numbers.
pub struct Source<'a> {
    /// The scene file, or the name that errors show in place of a file.
    pub file: &'a Path,
    /// The whole text; empty where a program made the tables.
    pub text: &'a str,
    /// The meshes in memory to which `{ mesh = ".." }` may refer by name.
    pub meshes: &'a Meshes,
}

impl<'a> Source<'a> {
    /// The source for the text of a file, which cannot refer to meshes in memory.
    pub fn of_file(file: &'a Path, text: &'a str) -> Self {
        Source { file, text, meshes: Meshes::none() }
    }

    fn line(&self, offset: Option<usize>) -> Option<usize> {
        let before = &self.text.as_bytes()[..offset?.min(self.text.len())];
        Some(1 + before.iter().filter(|&&byte| byte == b'\n').count())
    }

    /// Parses the text as TOML; the error is the parser's message with its line.
    pub fn parse(&self) -> Result<Node> {
        let document = DeTable::parse(self.text).map_err(|error| {
            let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            let line = error.span().and_then(|span| self.line(Some(span.start)));
            match error.span().and_then(|span| self.text.get(span)) {
                Some(key) if message == "duplicate key" => {
                    let problem = format!("`{}` is given a second time", key.trim().escape_debug());
                    let remedy = "keep one of the two; what there may be many of is a list, such as [[body]]";
                    Error::input(self.file, line, problem, remedy)
                }
                _ => Error::input(self.file, line, format!("not TOML: {message}"), "correct the line"),
            }
        })?;
        Ok(Node { kind: Kind::Table(entries(document.get_ref())), offset: Some(0) })
    }
}

/// A table of the scene, with its dotted path.
#[derive(Clone)]
pub struct Table<'a> {
    source: &'a Source<'a>,
    path: String,
    table: &'a Entries,
    offset: Option<usize>,
}

impl<'a> Table<'a> {
    /// The root table of a document; fails if it has a key that is not in `known`.
    pub fn root(source: &'a Source<'a>, document: &'a Node, known: &TableKeys) -> Result<Self> {
        Value { source, key: String::new(), value: document }.table(known)
    }

    /// This table with another dotted path: once the `name` of an element of an array of tables has been read, the name
    /// replaces the index in the path (`body.head` in place of `body[0]`).
    pub fn renamed(mut self, path: String) -> Self {
        self.path = path;
        self
    }

    /// Fails if the table has a key that is not in `known`; the error suggests the known key most similar to it.
    pub fn only(&self, known: &TableKeys) -> Result<()> {
        let known = &known.names()[..];
        let Some((key, offset, _)) = self.table.iter().find(|(key, ..)| !known.contains(&key.as_str())) else {
            return Ok(());
        };
        let remedy = match nearest(key, known) {
            Some((name, true)) => format!("did you mean `{name}`?"),
            Some((name, false)) => format!("the nearest known key is `{name}`; known here: {}", known.join(", ")),
            None => "remove it".into(),
        };
        let line = self.source.line(*offset);
        let problem = format!("unknown key `{}`", self.dotted(key));
        Err(Error::input(self.source.file, line, problem, remedy))
    }

    /// The dotted path of one of this table's keys.
    pub fn dotted(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    /// The value of a key, if the table has the key.
    pub fn get(&self, key: &str) -> Option<Value<'a>> {
        let (.., value) = self.table.iter().find(|(name, ..)| name == key)?;
        Some(Value { source: self.source, key: self.dotted(key), value })
    }

    /// The value of a required key.
    pub fn need(&self, key: &str) -> Result<Value<'a>> {
        self.get(key).ok_or_else(|| self.error(key, "missing", "add it"))
    }

    /// Whether the table has the key.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// The value of a key, as `read` returns it; `default` where the key is absent.
    pub fn or<T>(&self, key: &str, default: T, read: impl Fn(&Value<'a>) -> Result<T>) -> Result<T> {
        self.get(key).map_or(Ok(default), |value| read(&value))
    }

    /// The value of a key, as `read` returns it; `None` where the key is absent.
    pub fn option<T>(&self, key: &str, read: impl Fn(&Value<'a>) -> Result<T>) -> Result<Option<T>> {
        self.get(key).map(|value| read(&value)).transpose()
    }

    /// The one key of `choices` that the table has; fails if the table has none of them, or more than one.
    pub fn exactly_one(&self, choices: &[&'static str]) -> Result<&'static str> {
        let present: Vec<_> = choices.iter().copied().filter(|key| self.has(key)).collect();
        match present[..] {
            [only] => Ok(only),
            [] => Err(self.error(choices[0], "missing", format!("give exactly one of: {}", choices.join(", ")))),
            _ => Err(self.error(present[1], format!("given together with `{}`", present[0]), "give only one of them")),
        }
    }

    /// An error for a problem that a check found in the values of this table. The problem has a dotted path; the error
    /// names the line of the first key in that path.
    pub fn wrong(&self, Problem { key, problem, remedy }: Problem) -> Error {
        let first = key.split(['.', '[']).next().unwrap_or_default();
        if first == key {
            return self.error(first, problem, remedy);
        }
        let line = self.get(first).map_or(self.offset, |value| value.value.offset);
        let problem = format!("`{}`: {problem}", self.dotted(&key));
        Error::input(self.source.file, self.source.line(line), problem, remedy)
    }

    /// An error about one of this table's keys, at the key's line; if the key is absent, at the table's line.
    pub fn error(&self, key: &str, problem: impl Into<String>, remedy: impl Into<String>) -> Error {
        match self.get(key) {
            Some(value) => value.error(problem, remedy),
            None => {
                let problem = format!("`{}`: {}", self.dotted(key), problem.into());
                Error::input(self.source.file, self.source.line(self.offset), problem, remedy)
            }
        }
    }
}

/// A value with its place in the file.
#[derive(Clone)]
pub struct Value<'a> {
    source: &'a Source<'a>,
    /// Dotted path of the value.
    pub key: String,
    value: &'a Node,
}

impl<'a> Value<'a> {
    /// An error about this value: `file:line: `key`: problem; remedy`.
    pub fn error(&self, problem: impl Into<String>, remedy: impl Into<String>) -> Error {
        let line = self.source.line(self.value.offset);
        Error::input(self.source.file, line, format!("`{}`: {}", self.key, problem.into()), remedy)
    }

    fn wrong_type(&self, wanted: &str) -> Error {
        let kind = self.value.kind.name();
        self.error(format!("is of type {kind}"), format!("give {wanted}"))
    }

    /// Reads a number, which must be finite and at most 1e30 in magnitude.
    pub fn number(&self) -> Result<f64> {
        let parsed = match &self.value.kind {
            Kind::Float(float) => *float,
            Kind::Integer(_, integer) => integer.map(|i| i as f64),
            _ => return Err(self.wrong_type("a number")),
        };
        let x = parsed.ok_or_else(|| self.error("cannot be read as a number", "give a finite number"))?;
        self.held(x, check::finite(x))
    }

    /// Returns `value` if the check found no problem; otherwise an error about this value, with the problem found.
    pub fn held<T>(&self, value: T, check: Check) -> Result<T> {
        check.map(|()| value).map_err(|problem| self.error(problem.problem, problem.remedy))
    }

    /// Reads a number, which must pass the check `rule`.
    pub fn ruled(&self, rule: impl Fn(f64) -> Check) -> Result<f64> {
        let x = self.number()?;
        self.held(x, rule(x))
    }

    /// Reads a number greater than zero.
    pub fn positive(&self) -> Result<f64> {
        self.ruled(check::positive)
    }

    /// Reads a number that is zero or more.
    pub fn not_negative(&self) -> Result<f64> {
        self.ruled(check::not_negative)
    }

    /// Reads a number greater than zero, or the string `"auto"`, for which it returns `None`.
    pub fn auto_or_positive(&self) -> Result<Option<f64>> {
        if self.is_auto()? { Ok(None) } else { self.positive().map(Some) }
    }

    /// Reads a number that is zero or more, or the string `"auto"`, for which it returns `None`.
    pub fn auto_or_not_negative(&self) -> Result<Option<f64>> {
        if self.is_auto()? { Ok(None) } else { self.not_negative().map(Some) }
    }

    /// Whether the value is the string `"auto"`; any other string is an error.
    fn is_auto(&self) -> Result<bool> {
        match &self.value.kind {
            Kind::Text(text) if text == "auto" => Ok(true),
            Kind::Text(other) => Err(self.error(format!("is \"{other}\""), "give \"auto\" or a number")),
            _ => Ok(false),
        }
    }

    /// Reads a whole number from `low` to `high`.
    pub fn whole(&self, low: u32, high: u32) -> Result<u32> {
        let Kind::Integer(written, integer) = &self.value.kind else { return Err(self.wrong_type("a whole number")) };
        integer
            .and_then(|i| u32::try_from(i).ok())
            .filter(|i| (low..=high).contains(i))
            .ok_or_else(|| self.error(format!("is {written}"), format!("give a whole number from {low} to {high}")))
    }

    /// Reads a whole number of either sign.
    pub fn integer(&self) -> Result<i64> {
        let Kind::Integer(written, integer) = &self.value.kind else { return Err(self.wrong_type("a whole number")) };
        integer.ok_or_else(|| self.error(format!("is {written}"), "give a whole number of 64 bits"))
    }

    /// Reads a boolean that must be `true`, as in `all = true`.
    pub fn must_be_true(&self) -> Result<()> {
        match self.value.kind {
            Kind::Truth(true) => Ok(()),
            Kind::Truth(false) => Err(self.error("is false", "write true, or leave the key out")),
            _ => Err(self.wrong_type("true")),
        }
    }

    /// Reads a boolean.
    pub fn truth(&self) -> Result<bool> {
        if let Kind::Truth(truth) = self.value.kind { Ok(truth) } else { Err(self.wrong_type("true or false")) }
    }

    /// Whether the value is a string.
    pub fn is_text(&self) -> bool {
        matches!(self.value.kind, Kind::Text(_))
    }

    /// Reads a string.
    pub fn text(&self) -> Result<&'a str> {
        if let Kind::Text(text) = &self.value.kind { Ok(text) } else { Err(self.wrong_type("a string in quotes")) }
    }

    /// Reads a string that is one of the names in `choices`, and returns the value of that name. `what` is the word by
    /// which errors call such a name, for example "preset".
    pub fn one_of<T: Copy>(&self, what: &str, choices: &[(&str, T)]) -> Result<T> {
        let text = self.text()?;
        let found = choices.iter().find(|(name, _)| *name == text);
        found.map(|&(_, choice)| choice).ok_or_else(|| {
            let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
            self.error(format!("there is no {what} \"{}\"", text.escape_debug()), suggest(text, &names))
        })
    }

    /// Reads a name, which consists of letters, digits, `_`, `-` and `.`, because it becomes part of file names and
    /// column headings.
    pub fn name(&self) -> Result<String> {
        let text = self.text()?;
        self.held(text.into(), check::name(text))
    }

    /// Reads a path, relative to the scene file's folder, to an existing file.
    pub fn file(&self) -> Result<PathBuf> {
        let path = self.source.file.parent().unwrap_or(Path::new("")).join(self.text()?);
        let problem = match files::irregular(&path) {
            Some(problem) => format!("{} {problem}", path.display()),
            None => match path.metadata() {
                Ok(_) => return Ok(path),
                Err(error) if error.kind() == ErrorKind::NotFound => format!("there is no file {}", path.display()),
                Err(error) => format!("{} cannot be read: {error}", path.display()),
            },
        };
        Err(self.error(problem, "correct the path; it is relative to the scene file"))
    }

    /// Reads the name of a mesh in memory, and returns the mesh that `find` finds by this name.
    pub fn mesh<T>(&self, find: impl Fn(&Meshes, &str) -> std::result::Result<T, Vec<String>>) -> Result<T> {
        let name = self.text()?;
        find(self.source.meshes, name).map_err(|known| {
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            self.error(format!("there is no mesh \"{}\" in memory", name.escape_debug()), suggest(name, &known))
        })
    }

    /// The elements of an array; the dotted path of each contains its index.
    pub fn array(&self) -> Result<Vec<Value<'a>>> {
        let Kind::Array(array) = &self.value.kind else { return Err(self.wrong_type("an array")) };
        let element = |(index, value)| Value { source: self.source, key: format!("{}[{index}]", self.key), value };
        Ok(array.iter().enumerate().map(element).collect())
    }

    /// Reads an array of exactly N elements, each by `read`.
    pub fn array_of<T: Copy + Default, const N: usize>(
        &self,
        read: impl Fn(&Value<'a>) -> Result<T>,
    ) -> Result<[T; N]> {
        let elements = self.array()?;
        if elements.len() != N {
            return Err(self.error(format!("has {} elements", elements.len()), format!("give {N} elements")));
        }
        let mut result = [T::default(); N];
        for (slot, element) in result.iter_mut().zip(&elements) {
            *slot = read(element)?;
        }
        Ok(result)
    }

    /// Reads an array of three numbers.
    pub fn vector(&self) -> Result<DVec3> {
        self.array_of(Value::number).map(DVec3::from_array)
    }

    /// Reads a unit quaternion x y z w and normalises it.
    pub fn quaternion(&self) -> Result<DQuat> {
        let [x, y, z, w] = self.array_of(Value::number)?;
        check::unit_quaternion([x, y, z, w]).map_err(|problem| self.error(problem.problem, problem.remedy))
    }

    /// Reads a table whose keys are all in `known`.
    pub fn table(&self, known: &TableKeys) -> Result<Table<'a>> {
        let table = self.unchecked_table()?;
        table.only(known)?;
        Ok(table)
    }

    /// Whether the value is an array.
    pub fn is_array(&self) -> bool {
        matches!(self.value.kind, Kind::Array(_))
    }

    /// Reads a table whose keys are not checked yet; [`Table::only`] checks them.
    pub fn unchecked_table(&self) -> Result<Table<'a>> {
        let Kind::Table(table) = &self.value.kind else { return Err(self.wrong_type("a table")) };
        Ok(Table { source: self.source, path: self.key.clone(), table, offset: self.value.offset })
    }
}

/// The name in `known` that is most similar to `text` (the first of several equally similar ones), and whether it is so
/// similar that it was probably meant.
fn nearest<'a>(text: &str, known: &[&'a str]) -> Option<(&'a str, bool)> {
    let likeness = |name: &&'a str| (strsim::jaro_winkler(text, name), *name);
    let (likeness, name) = known.iter().rev().map(likeness).max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((name, likeness > LIKENESS))
}

/// A remedy for a text that is not a known name: it lists the known names, and suggests the most similar one.
pub fn suggest(text: &str, known: &[&str]) -> String {
    let all = if known.is_empty() { "none".into() } else { known.join(", ") };
    match nearest(text, known) {
        Some((name, true)) => format!("did you mean \"{name}\"? known: {all}"),
        _ => format!("known: {all}"),
    }
}
