//! Why a case did not pass: one sentence.

use super::{AxisResult, Judged};
use crate::report::Flags;

/// Why a case of an axis was degraded or failed, and what can be done about it.
pub fn reason(axis: &AxisResult, case: &Judged) -> String {
    let _ = axis;
    Flags(case.flags).names().collect::<Vec<_>>().join(", ")
}
