//! Reads from the GLSL text of a shader what its SPIR-V binary has lost: comments on structs, members, buffers and push
//! constants, and the values of constants. Part of the build script.

/// A `const uint` or `const float` of a header (a file of `shaders/shared`) whose value is a number.
pub struct Constant {
    /// `u32` or `f32`.
    pub ty: &'static str,
    /// Its name.
    pub name: String,
    /// Its value, in Rust.
    pub value: String,
    /// The comment at the end of its line.
    pub comment: String,
}

/// The constants of a header whose value is a number. Constants whose value is an expression get no Rust constant.
pub fn constants(header: &str) -> Vec<Constant> {
    let constant = |line: &str| {
        let (declaration, comment) = split(line);
        let (ty, rest) = declaration.strip_prefix("const ")?.split_once(' ')?;
        let ty = match ty {
            "uint" => "u32",
            "float" => "f32",
            _ => return None,
        };
        let (name, value) = rest.strip_suffix(';')?.split_once(" = ")?;
        let value = value.trim_end_matches('u');
        let is_number = value.parse::<f64>().is_ok() || value.strip_prefix("0x").is_some_and(is_hexadecimal);
        is_number.then(|| Constant { ty, name: name.into(), value: value.into(), comment })
    };
    header.lines().filter_map(constant).collect()
}

fn is_hexadecimal(digits: &str) -> bool {
    !digits.is_empty() && digits.chars().all(|c| c.is_ascii_hexdigit())
}

/// Splits a line into its code and the comment at its end.
fn split(line: &str) -> (&str, String) {
    let (code, comment) = line.split_once("//").unwrap_or((line, ""));
    (code.trim(), comment.trim().into())
}

/// Whether a GLSL text defines a struct.
pub fn defines(text: &str, structure: &str) -> bool {
    text.lines().any(|line| line == format!("struct {structure} {{"))
}

/// The comment above the definition of a struct; empty where there is none.
pub fn above(text: &str, structure: &str) -> String {
    let before: Vec<_> = text.lines().take_while(|line| *line != format!("struct {structure} {{")).collect();
    let lines: Vec<_> = before.iter().rev().map_while(|line| line.strip_prefix("//")).map(str::trim).collect();
    lines.into_iter().rev().collect::<Vec<_>>().join(" ")
}

/// The comment at the end of a struct member's line, in the definition of the struct; empty where there is none.
pub fn member(text: &str, structure: &str, member: &str) -> String {
    let definition = text.lines().skip_while(|line| *line != format!("struct {structure} {{")).skip(1);
    let mut lines = definition.take_while(|line| *line != "};").map(split).peekable();
    while let Some((code, mut comment)) = lines.next() {
        if names(code, member) {
            // The comment continues on following lines that have no code.
            while let Some((_, more)) = lines.next_if(|(code, _)| code.is_empty()) {
                comment = format!("{comment} {more}");
            }
            return comment;
        }
    }
    String::new()
}

/// The comment at the end of the line that declares a buffer or push constants; empty if none.
pub fn declaration(text: &str, name: &str) -> String {
    let declares = |line: &&str| line.starts_with("layout(") || line.starts_with("READ_ONLY(");
    text.lines().filter(declares).map(split).find(|(code, _)| names(code, name)).map(|(_, c)| c).unwrap_or_default()
}

/// Whether a name occurs in a line of code, as a whole word.
fn names(code: &str, name: &str) -> bool {
    code.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == name)
}
