//! Ticks of a recording (iterations of the haptic loop) as a CSV table.

use std::io::Write;

use palpate::internal::haptics::servo::Tick;

use super::fields;

/// Writes ticks as CSV: a heading, then one row a tick, with numbers in the shortest form that reads back as the same
/// f64. The columns are those of [`fields::of_tick`]; cells without a value are empty.
pub struct Table<W: Write> {
    writer: csv::Writer<W>,
    has_heading: bool,
}

impl<W: Write> Table<W> {
    /// An empty table; its heading is written with the first tick.
    pub fn new(writer: W) -> Table<W> {
        Table { writer: csv::Writer::from_writer(writer), has_heading: false }
    }

    /// Writes the row of a tick.
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
