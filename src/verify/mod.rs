//! Baked assets against the unbiased reference, in numbers and pictures.

pub mod poses;
pub mod report;
pub mod statistics;
pub mod view;
