//! `palpate bench accuracy`: error against run time.

pub mod curve;
