//! `trace.csv`: the reports of a run's steps, one row at the end of each step.

use std::io::Write;

use palpate::{Simulation, StepReport, StepWork, ToolReport};

/// Columns of a tool: poses of the tool and of its device, force and torque on the tool.
const TOOL: [&str; 20] = [
    "tool_x",
    "tool_y",
    "tool_z",
    "tool_qx",
    "tool_qy",
    "tool_qz",
    "tool_qw",
    "device_x",
    "device_y",
    "device_z",
    "device_qx",
    "device_qy",
    "device_qz",
    "device_qw",
    "force_x",
    "force_y",
    "force_z",
    "torque_x",
    "torque_y",
    "torque_z",
];
/// Columns after those of the tool.
const STEP: &str = ",contacts,max_depth_m,iterations,residual,flags,step_us";
/// Columns after the reactions: what the step asked of the GPU.
const WORK: &str = ",solves,submits,planned_iterations,dependent_passes,gpu_us";

/// Writes step reports as rows of CSV. Each number has the shortest form that is read back as the same f64, except
/// `step_us` and `gpu_us`, which have one decimal.
pub struct Trace<W: Write> {
    writer: W,
    probes: usize,
    reactions: usize,
    further_tools: usize,
}

/// The names by which columns of a scene's own are called.
#[derive(Debug, Clone, Default)]
pub struct Names {
    /// The scene's probes (points of skins, the bodies' surface meshes, whose paths are recorded).
    pub probes: Vec<String>,
    /// What holds the bodies whose reactions are reported: supports, and fixed and driven cores (rigid parts).
    pub reactions: Vec<String>,
    /// The tools after the first.
    pub further_tools: Vec<String>,
}

impl Names {
    /// The names in a simulation.
    pub fn of(simulation: &Simulation) -> Names {
        let probes = simulation.scene().probes.iter().map(|probe| probe.name.clone()).collect();
        let further_tools = simulation.scene().further_tools.iter().map(|tool| tool.name.clone()).collect();
        Names { probes, reactions: simulation.reaction_names().map(Into::into).collect(), further_tools }
    }
}

impl<W: Write> Trace<W> {
    /// Starts a trace and writes its heading.
    pub fn new(mut writer: W, names: &Names) -> std::io::Result<Self> {
        write!(writer, "step,time_s")?;
        TOOL.iter().try_for_each(|column| write!(writer, ",{column}"))?;
        write!(writer, "{STEP}")?;
        for name in &names.probes {
            write!(writer, ",{name}_x,{name}_y,{name}_z")?;
        }
        for name in &names.reactions {
            write!(writer, ",{name}_fx,{name}_fy,{name}_fz,{name}_tx,{name}_ty,{name}_tz")?;
        }
        for name in &names.further_tools {
            TOOL.iter().try_for_each(|column| write!(writer, ",{name}:{column}"))?;
        }
        writeln!(writer, "{WORK}")?;
        let (probes, reactions) = (names.probes.len(), names.reactions.len());
        Ok(Trace { writer, probes, reactions, further_tools: names.further_tools.len() })
    }

    /// Writes one row, which must hold as many probes, reactions and tools as the heading.
    pub fn write(&mut self, row: &StepReport) -> std::io::Result<()> {
        assert_eq!(row.probes.len(), self.probes, "a row must have as many probes as the heading");
        assert_eq!(row.reactions.len(), self.reactions, "a row must have as many reactions as the heading");
        assert_eq!(row.further_tools.len(), self.further_tools, "a row must have as many tools as the heading");
        let w = &mut self.writer;
        write!(w, "{},{:?}", row.step, row.time)?;
        match &row.tool {
            Some(tool) => write_tool(w, tool)?,
            None => write!(w, "{}", ",".repeat(TOOL.len()))?,
        }
        write!(w, ",{}", row.contacts.map(|count| count.to_string()).unwrap_or_default())?;
        write!(w, ",{}", row.max_depth.map(|depth| format!("{depth:?}")).unwrap_or_default())?;
        write!(w, ",{},{:?},{},{:.1}", row.iterations, row.residual, row.flags.0, row.step_us)?;
        for probe in &row.probes {
            write_numbers(w, &probe.to_array())?;
        }
        for reaction in &row.reactions {
            write_numbers(w, &reaction.force.to_array())?;
            write_numbers(w, &reaction.torque.to_array())?;
        }
        row.further_tools.iter().try_for_each(|tool| write_tool(w, tool))?;
        let StepWork { solves, submits, planned_iterations, dependent_passes, gpu_us } = row.work;
        let gpu_us = gpu_us.map(|us| format!("{us:.1}")).unwrap_or_default();
        writeln!(w, ",{solves},{submits},{planned_iterations},{dependent_passes},{gpu_us}")
    }

    /// Writes out the rows that are still buffered.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}

/// Writes the columns of a tool.
fn write_tool(w: &mut impl Write, tool: &ToolReport) -> std::io::Result<()> {
    for pose in [tool.tool, tool.device] {
        write_numbers(w, &pose.position.to_array())?;
        write_numbers(w, &pose.orientation.to_array())?;
    }
    write_numbers(w, &tool.force.to_array())?;
    write_numbers(w, &tool.torque.to_array())
}

/// Writes each number after a comma, in the debug form of f64: the shortest that is read back as the same number; very
/// small and very large numbers have an exponent.
fn write_numbers(w: &mut impl Write, numbers: &[f64]) -> std::io::Result<()> {
    numbers.iter().try_for_each(|number| write!(w, ",{number:?}"))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use palpate::{Flags, Wrench};

    use super::*;

    fn lines(rows: &[StepReport]) -> Vec<Vec<String>> {
        let (probes, reactions) = (vec!["nose".into()], vec!["face.jaw".into()]);
        let names = Names { probes, reactions, further_tools: vec!["right".into()] };
        let mut bytes = Vec::new();
        let mut trace = Trace::new(&mut bytes, &names).unwrap();
        rows.iter().for_each(|row| trace.write(row).unwrap());
        trace.finish().unwrap();
        let text = String::from_utf8(bytes).unwrap();
        text.lines().map(|line| line.split(',').map(Into::into).collect()).collect()
    }

    fn row() -> StepReport {
        StepReport {
            step: 7,
            time: 0.1 + 0.2,
            tool: Some(ToolReport { force: DVec3::new(1e-17, f64::from(0.1_f32), -3.0), ..Default::default() }),
            further_tools: vec![ToolReport { torque: DVec3::new(8.0, -9.0, 0.5), ..Default::default() }],
            contacts: Some(12),
            max_depth: Some(1.5e-4),
            normal_turn: Some(0.0),
            iterations: 9,
            residual: 3e-6,
            nonlinear_residual: None,
            flags: Flags::NOT_CONVERGED | Flags::FROZEN,
            parts: 1,
            step_us: 812.3456,
            work: StepWork {
                solves: 2,
                submits: 3,
                planned_iterations: 16,
                dependent_passes: 60,
                gpu_us: Some(700.25),
            },
            probes: vec![DVec3::new(0.5, 0.25, 1e9)],
            reactions: vec![Wrench { force: DVec3::new(1.0, -2.5, 3.0), torque: DVec3::new(4.0, 5.0, -6e-9) }],
        }
    }

    #[test]
    fn numbers_stand_under_their_heads_and_read_back_the_same() {
        let table = lines(&[row()]);
        let cell = |head: &str| table[1][table[0].iter().position(|name| name == head).unwrap()].as_str();
        assert_eq!(table[0].len(), table[1].len());
        assert_eq!((cell("step"), cell("contacts"), cell("flags"), cell("step_us")), ("7", "12", "129", "812.3"));
        let (row, number) = (row(), |head: &str| cell(head).parse::<f64>().unwrap());
        assert_eq!(number("time_s"), row.time);
        assert_eq!(DVec3::new(number("force_x"), number("force_y"), number("force_z")), row.tool.unwrap().force);
        assert_eq!((number("tool_qw"), number("device_qw"), number("torque_z")), (1.0, 1.0, 0.0));
        assert_eq!((number("max_depth_m"), number("residual"), number("nose_z")), (1.5e-4, 3e-6, 1e9));
        assert_eq!((number("face.jaw_fy"), number("face.jaw_tz")), (-2.5, -6e-9));
        assert_eq!((number("right:tool_qw"), number("right:torque_y"), number("right:torque_z")), (1.0, -9.0, 0.5));
        let work = ["solves", "submits", "planned_iterations", "dependent_passes", "gpu_us"].map(cell);
        assert_eq!(work, ["2", "3", "16", "60", "700.2"]);
    }

    #[test]
    fn a_scene_without_a_tool_leaves_its_cells_empty() {
        let table = lines(&[StepReport { tool: None, contacts: None, max_depth: None, ..row() }]);
        assert_eq!(table[0].len(), table[1].len());
        for (head, cell) in table[0].iter().zip(&table[1]) {
            let is_of_tool = ["tool_", "device_", "force_", "torque_", "contacts", "max_depth"].iter();
            assert_eq!(
                cell.is_empty(),
                is_of_tool.clone().any(|start| head.starts_with(start)),
                "column {head} has the cell `{cell}`"
            );
        }
    }
}
