//! The table of a tradeoff: columns, Pareto front and knee, and the table as page, plot, CSV and JSON.

mod column;
mod page;
mod pareto;
mod plot;
mod table;

#[cfg(test)]
mod tests;

pub(crate) use column::{Column, ColumnInfo, Costs, Shown, Spread, Unit, figure, readable_volume};
pub(crate) use page::{csv_line, write};
pub(crate) use plot::escaped;
pub(crate) use table::{About, Setting, Table, TableRow, Wording};
