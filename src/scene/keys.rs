//! TOML with its place in the file: every key and value remembers its dotted path and its line, so that whatever is
//! wrong with it is reported as `scene.toml:12: `body.head.material.young`: ...`. `load.rs` reads scenes through this.
//!
//! serde's own derive is not used: it reports unknown keys without their table, and a value that parses but is out of
//! range without its line.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::meshes::Meshes;
use crate::{Error, Result};

/// Greatest magnitude of a number: it must fit in single precision with room for a product.
pub(super) const LARGEST: f64 = 1e30;
/// Least magnitude of a number that must be greater than zero, for the same reason.
const SMALLEST: f64 = 1e-30;
/// Characters of a name at most: with an extension it must be a file name everywhere.
const LONGEST_NAME: usize = 100;
/// How far from one the length of a quaternion may be: more is a typing error, less is rounding.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Likeness (Jaro-Winkler, 0 to 1) above which a known key is offered in place of an unknown one.
const LIKENESS: f64 = 0.7;

/// A file and its text: turns byte offsets into lines.
pub struct Source<'a> {
    /// The scene file.
    pub file: &'a Path,
    /// Its whole text.
    pub text: &'a str,
    /// Whether somebody wrote the text: errors then tell the line.
    pub has_lines: bool,
    /// What `{ mesh = ".." }` may name.
    pub meshes: &'a Meshes,
}

impl<'a> Source<'a> {
    /// A file, which names no meshes in memory.
    pub fn of_file(file: &'a Path, text: &'a str) -> Self {
        Source { file, text, has_lines: true, meshes: Meshes::none() }
    }

    fn line(&self, offset: usize) -> Option<usize> {
        let before = &self.text.as_bytes()[..offset.min(self.text.len())];
        self.has_lines.then(|| 1 + before.iter().filter(|&&byte| byte == b'\n').count())
    }

    /// The document's root table, or the parser's complaint with its line.
    pub fn parse(&self) -> Result<Spanned<DeTable<'_>>> {
        DeTable::parse(self.text).map_err(|error| {
            let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            let line = error.span().and_then(|span| self.line(span.start));
            Error::input(self.file, line, format!("not TOML: {message}"), "correct the line")
        })
    }
}

/// A table whose keys have been checked against the known ones.
#[derive(Clone)]
pub struct Table<'a> {
    source: &'a Source<'a>,
    path: String,
    table: &'a DeTable<'a>,
    offset: usize,
}

impl<'a> Table<'a> {
    /// The root table; refuses keys that are not in `known`.
    pub fn root(source: &'a Source<'a>, table: &'a Spanned<DeTable<'a>>, known: &[&str]) -> Result<Self> {
        let root = Table { source, path: String::new(), table: table.get_ref(), offset: 0 };
        root.only(known)?;
        Ok(root)
    }

    /// The same table under another dotted path: an element of an array of tables once its name is known.
    pub fn renamed(mut self, path: String) -> Self {
        self.path = path;
        self
    }

    /// Refuses keys that are not in `known`, and offers the nearest.
    pub fn only(&self, known: &[&str]) -> Result<()> {
        let Some((key, _)) = self.table.iter().find(|(key, _)| !known.contains(&key.get_ref().as_ref())) else {
            return Ok(());
        };
        let remedy = match nearest(key.get_ref(), known) {
            Some((name, true)) => format!("did you mean `{name}`?"),
            Some((name, false)) => format!("the nearest known key is `{name}`; known here: {}", known.join(", ")),
            None => "remove it".into(),
        };
        let line = self.source.line(key.span().start);
        let problem = format!("unknown key `{}`", self.dotted(key.get_ref()));
        Err(Error::input(self.source.file, line, problem, remedy))
    }

    /// Dotted path of one of this table's keys.
    pub fn dotted(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    /// The value of a key.
    pub fn get(&self, key: &str) -> Option<Value<'a>> {
        let (_, value) = self.table.iter().find(|(name, _)| name.get_ref() == key)?;
        Some(Value { source: self.source, key: self.dotted(key), value })
    }

    /// The value of a key that must be there.
    pub fn need(&self, key: &str) -> Result<Value<'a>> {
        self.get(key).ok_or_else(|| self.error(key, "missing", "add it"))
    }

    /// Whether the table has the key.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// A key's value read by `read`, or `default` where the key is absent.
    pub fn or<T>(&self, key: &str, default: T, read: impl Fn(&Value<'a>) -> Result<T>) -> Result<T> {
        self.get(key).map_or(Ok(default), |value| read(&value))
    }

    /// A key's value read by `read`, if the key is there.
    pub fn option<T>(&self, key: &str, read: impl Fn(&Value<'a>) -> Result<T>) -> Result<Option<T>> {
        self.get(key).map(|value| read(&value)).transpose()
    }

    /// The only one of `choices` that the table has; an error when there is none or more than one.
    pub fn exactly_one(&self, choices: &[&'static str]) -> Result<&'static str> {
        let present: Vec<_> = choices.iter().copied().filter(|key| self.has(key)).collect();
        match present[..] {
            [only] => Ok(only),
            [] => Err(self.error(choices[0], "missing", format!("give exactly one of: {}", choices.join(", ")))),
            _ => Err(self.error(present[1], format!("given beside `{}`", present[0]), "give exactly one of them")),
        }
    }

    /// An error about one of this table's keys, at its line (or the table's, where the key is absent).
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

/// A value and where it stands.
#[derive(Clone)]
pub struct Value<'a> {
    source: &'a Source<'a>,
    /// Dotted path.
    pub key: String,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Value<'a> {
    /// An error about this value: `file:line: `key`: problem; remedy`.
    pub fn error(&self, problem: impl Into<String>, remedy: impl Into<String>) -> Error {
        let line = self.source.line(self.value.span().start);
        Error::input(self.source.file, line, format!("`{}`: {}", self.key, problem.into()), remedy)
    }

    fn wrong_type(&self, wanted: &str) -> Error {
        let kind = self.value.get_ref().type_str();
        self.error(format!("is of type {kind}"), format!("give {wanted}"))
    }

    /// A finite number within single precision.
    pub fn number(&self) -> Result<f64> {
        let parsed = match self.value.get_ref() {
            DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
            DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|i| i as f64),
            _ => return Err(self.wrong_type("a number")),
        };
        match parsed {
            Some(x) if x.is_finite() && x.abs() <= LARGEST => Ok(x),
            Some(x) => Err(self.error(format!("is {x:?}"), "give a finite number below 1e30 in magnitude")),
            None => Err(self.error("is not a number that fits", "give a finite number")),
        }
    }

    /// A number greater than zero.
    pub fn positive(&self) -> Result<f64> {
        match self.number()? {
            x if x >= SMALLEST => Ok(x),
            x => {
                Err(self.error(format!("is {x:?}"), format!("give a number greater than zero, {SMALLEST:e} at least")))
            }
        }
    }

    /// A number that is zero or more.
    pub fn not_negative(&self) -> Result<f64> {
        match self.number()? {
            x if x >= 0.0 => Ok(x),
            x => Err(self.error(format!("is {x:?}"), "give zero or a number greater than zero")),
        }
    }

    /// A number greater than zero, or `"auto"` (`None`).
    pub fn auto_or_positive(&self) -> Result<Option<f64>> {
        if self.is_auto()? { Ok(None) } else { self.positive().map(Some) }
    }

    /// A number that is zero or more, or `"auto"` (`None`).
    pub fn auto_or_not_negative(&self) -> Result<Option<f64>> {
        if self.is_auto()? { Ok(None) } else { self.not_negative().map(Some) }
    }

    fn is_auto(&self) -> Result<bool> {
        match self.value.get_ref().as_str() {
            Some("auto") => Ok(true),
            Some(other) => Err(self.error(format!("is \"{other}\""), "give \"auto\" or a number")),
            None => Ok(false),
        }
    }

    /// A whole number from `low` to `high`.
    pub fn whole(&self, low: u32, high: u32) -> Result<u32> {
        let DeValue::Integer(integer) = self.value.get_ref() else { return Err(self.wrong_type("a whole number")) };
        i64::from_str_radix(integer.as_str(), integer.radix())
            .ok()
            .and_then(|i| u32::try_from(i).ok())
            .filter(|i| (low..=high).contains(i))
            .ok_or_else(|| self.error(format!("is {integer}"), format!("give a whole number from {low} to {high}")))
    }

    /// A whole number of either sign.
    pub fn integer(&self) -> Result<i64> {
        let DeValue::Integer(integer) = self.value.get_ref() else { return Err(self.wrong_type("a whole number")) };
        i64::from_str_radix(integer.as_str(), integer.radix())
            .map_err(|_| self.error(format!("is {integer}"), "give a whole number of 64 bits"))
    }

    /// A boolean that must be `true` (`all = true`).
    pub fn must_be_true(&self) -> Result<()> {
        match self.value.get_ref().as_bool() {
            Some(true) => Ok(()),
            Some(false) => Err(self.error("is false", "write true, or leave the key out")),
            None => Err(self.wrong_type("true")),
        }
    }

    /// A boolean.
    pub fn truth(&self) -> Result<bool> {
        self.value.get_ref().as_bool().ok_or_else(|| self.wrong_type("true or false"))
    }

    /// Whether the value is a string.
    pub fn is_text(&self) -> bool {
        self.value.get_ref().is_str()
    }

    /// A string.
    pub fn text(&self) -> Result<&'a str> {
        self.value.get_ref().as_str().ok_or_else(|| self.wrong_type("a string in quotes"))
    }

    /// What one of `choices` stands for; `what` names their kind in errors.
    pub fn one_of<T: Copy>(&self, what: &str, choices: &[(&str, T)]) -> Result<T> {
        let text = self.text()?;
        let found = choices.iter().find(|(name, _)| *name == text);
        found.map(|&(_, choice)| choice).ok_or_else(|| {
            let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
            self.error(format!("there is no {what} \"{}\"", text.escape_debug()), suggest(text, &names))
        })
    }

    /// A name: letters, digits, `_`, `-` and `.`, for it becomes part of file names and column heads.
    pub fn name(&self) -> Result<String> {
        let text = self.text()?;
        let allowed = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
        if text.is_empty() || text.starts_with('.') || !text.chars().all(allowed) {
            let remedy = "use letters, digits, '_', '-' and '.', and do not start with '.'";
            return Err(self.error(format!("\"{}\" cannot be a name", text.escape_debug()), remedy));
        }
        if text.len() > LONGEST_NAME {
            let problem = format!("a name of {} characters", text.len());
            return Err(self.error(problem, format!("use at most {LONGEST_NAME}: it becomes part of file names")));
        }
        Ok(text.into())
    }

    /// A path to an existing file, relative to the scene file's folder.
    pub fn file(&self) -> Result<PathBuf> {
        let path = self.source.file.parent().unwrap_or(Path::new("")).join(self.text()?);
        if !path.is_file() {
            let problem = format!("there is no file {}", path.display());
            return Err(self.error(problem, "correct the path; it is relative to the scene file"));
        }
        Ok(path)
    }

    /// What the scene's maker handed over under this name, looked for by `find`.
    pub fn mesh<T>(&self, find: impl Fn(&Meshes, &str) -> std::result::Result<T, Vec<String>>) -> Result<T> {
        let name = self.text()?;
        find(self.source.meshes, name).map_err(|known| {
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            self.error(format!("no mesh \"{}\" was handed over", name.escape_debug()), suggest(name, &known))
        })
    }

    /// The elements of an array, each with its index in its key.
    pub fn array(&self) -> Result<Vec<Value<'a>>> {
        let array = self.value.get_ref().as_array().ok_or_else(|| self.wrong_type("an array"))?;
        let element = |(index, value)| Value { source: self.source, key: format!("{}[{index}]", self.key), value };
        Ok(array.iter().enumerate().map(element).collect())
    }

    /// An array of exactly N elements, each read by `read`.
    pub fn array_of<T: Copy + Default, const N: usize>(
        &self,
        read: impl Fn(&Value<'a>) -> Result<T>,
    ) -> Result<[T; N]> {
        let elements = self.array()?;
        if elements.len() != N {
            return Err(self.error(format!("has {} elements", elements.len()), format!("give {N}")));
        }
        let mut result = [T::default(); N];
        for (slot, element) in result.iter_mut().zip(&elements) {
            *slot = read(element)?;
        }
        Ok(result)
    }

    /// Three numbers.
    pub fn vector(&self) -> Result<DVec3> {
        self.array_of(Value::number).map(DVec3::from_array)
    }

    /// A unit quaternion x y z w, normalised.
    pub fn quaternion(&self) -> Result<DQuat> {
        let [x, y, z, w] = self.array_of(Value::number)?;
        unit_quaternion([x, y, z, w]).map_err(|(problem, remedy)| self.error(problem, remedy))
    }

    /// A table whose keys are all in `known`.
    pub fn table(&self, known: &[&str]) -> Result<Table<'a>> {
        let table = self.unchecked_table()?;
        table.only(known)?;
        Ok(table)
    }

    /// A table whose keys are still to be checked, by [`Table::only`].
    pub fn unchecked_table(&self) -> Result<Table<'a>> {
        let table = self.value.get_ref().as_table().ok_or_else(|| self.wrong_type("a table"))?;
        Ok(Table { source: self.source, path: self.key.clone(), table, offset: self.value.span().start })
    }
}

/// The known name most like a text, the first of equals, and whether it is so like that it was probably meant.
fn nearest<'a>(text: &str, known: &[&'a str]) -> Option<(&'a str, bool)> {
    let likeness = |name: &&'a str| (strsim::jaro_winkler(text, name), *name);
    let (likeness, name) = known.iter().rev().map(likeness).max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((name, likeness > LIKENESS))
}

/// A remedy for a text that is none of the known names: lists them, and offers the nearest.
pub fn suggest(text: &str, known: &[&str]) -> String {
    let all = if known.is_empty() { "none".into() } else { known.join(", ") };
    match nearest(text, known) {
        Some((name, true)) => format!("did you mean \"{name}\"? known: {all}"),
        _ => format!("known: {all}"),
    }
}

/// Normalises a quaternion x y z w whose length is one but for rounding; otherwise what is wrong and the remedy.
pub fn unit_quaternion(q: [f64; 4]) -> std::result::Result<DQuat, (String, &'static str)> {
    let quaternion = DQuat::from_array(q);
    let length = quaternion.length();
    if (length - 1.0).abs() <= UNIT_TOLERANCE {
        Ok(quaternion.normalize())
    } else {
        Err((format!("quaternion has length {length:.4e}"), "give a unit quaternion x y z w"))
    }
}
