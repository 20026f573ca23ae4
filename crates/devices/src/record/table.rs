//! Ticks of a recording (iterations of the haptic loop) as a CSV table.

use std::io::Write;

use palpate::internal::haptics::servo::Tick;

use super::{Header, fields};

/// Writes ticks as CSV: a heading, then one row a tick, with numbers in the shortest form that reads back as the same
/// f64. The columns are those of [`fields::of_tick`]; cells without a value are empty. In a session of several haptic
/// devices the first column, `tool`, has the name of the tool.
pub struct Table<W: Write> {
    writer: csv::Writer<W>,
    /// Names of the tools where there are several; otherwise none.
    tools: Vec<String>,
    has_heading: bool,
}

impl<W: Write> Table<W> {
    /// An empty table of the session that `header` describes; its heading is written with the first tick.
    pub fn new(writer: W, header: &Header) -> Table<W> {
        let tools = if header.leaders.len() > 1 {
            header.leaders.iter().map(|leader| leader.tool.clone()).collect()
        } else {
            vec![]
        };
        Table { writer: csv::Writer::from_writer(writer), tools, has_heading: false }
    }

    /// Writes the row of a tick of the tool `index`.
    pub fn write(&mut self, index: usize, tick: &Tick) -> std::io::Result<()> {
        let fields = fields::of_tick(tick);
        let tool = self.tools.get(index);
        if !std::mem::replace(&mut self.has_heading, true) {
            let names = fields.iter().map(|field| field.name());
            self.writer.write_record(tool.map(|_| "tool".into()).into_iter().chain(names))?;
        }
        Ok(self.writer.write_record(tool.cloned().into_iter().chain(fields.iter().map(|field| field.text())))?)
    }

    /// Writes out what is buffered.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}
