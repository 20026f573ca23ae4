//! Ticks as CSV.

use std::io::Write;

use palpate::internal::haptics::servo::Tick;

use super::fields;

/// Writes ticks as CSV: a heading, then a row each, numbers the shortest that read back as the same f64. The columns are
/// those of [`fields::of_tick`]; what could not be read is empty.
pub struct Table<W: Write> {
    writer: csv::Writer<W>,
    has_heading: bool,
}

impl<W: Write> Table<W> {
    /// A table; its heading comes with the first tick.
    pub fn new(writer: W) -> Table<W> {
        Table { writer: csv::Writer::from_writer(writer), has_heading: false }
    }

    /// Writes a row.
    pub fn write(&mut self, tick: &Tick) -> std::io::Result<()> {
        let fields = fields::of_tick(tick);
        if !std::mem::replace(&mut self.has_heading, true) {
            self.writer.write_record(fields.iter().map(|field| field.name()))?;
        }
        Ok(self.writer.write_record(fields.iter().map(|field| field.text()))?)
    }

    /// Writes out what is buffered.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}
