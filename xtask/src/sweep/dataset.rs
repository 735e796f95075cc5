//! The tidy long format of the data files: one row a run and step.

use needle_sim::{LogRow, RunLog};
use serde::Serialize;

/// Why rows could not be put in CSV.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DatasetError {
    #[error("cannot write rows as CSV")]
    Row(#[from] csv::Error),
    #[error("cannot finish the CSV")]
    End(#[source] std::io::Error),
}

/// All rows of all runs under one header: `run` and the fields of [`LogRow`]. Numbers have the fewest digits that read
/// back to the same double.
pub(super) fn encode(logs: &[RunLog]) -> Result<Vec<u8>, DatasetError> {
    let rows = logs
        .iter()
        .flat_map(|log| log.rows.iter().map(|row| (log.run.as_str(), row)));
    table("run", &LogRow::default(), rows)
}

/// A table whose header is `keys` and the field names of `example`; each row serialises to as many values.
pub(super) fn table(
    keys: &str,
    example: &impl Serialize,
    rows: impl Iterator<Item = impl Serialize>,
) -> Result<Vec<u8>, DatasetError> {
    let mut names = csv::Writer::from_writer(Vec::new());
    names.serialize(example)?;
    let names = finished(names)?;
    let header = names
        .split(|byte| *byte == b'\n')
        .next()
        .unwrap_or_default();
    let contents = [keys.as_bytes(), b",", header, b"\n"].concat();
    let mut writer = csv::WriterBuilder::new()
        .has_headers(false)
        .from_writer(contents);
    for row in rows {
        writer.serialize(row)?;
    }
    finished(writer)
}

fn finished(writer: csv::Writer<Vec<u8>>) -> Result<Vec<u8>, DatasetError> {
    writer
        .into_inner()
        .map_err(|error| DatasetError::End(error.into_error()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_is_the_documented_one_and_absent_values_are_empty() {
        let row = LogRow {
            step: 1,
            time_s: 0.1,
            z_mm: Some(0.1 + 0.2),
            ..LogRow::default()
        };
        let text = encode(&[RunLog {
            run: "N8".into(),
            dt_s: 0.1,
            rows: vec![row],
        }])
        .unwrap();
        let text = String::from_utf8(text).unwrap();
        let (header, row) = text.trim_end().split_once('\n').unwrap();
        assert_eq!(
            header,
            "run,step,time_s,x_mm,y_mm,z_mm,alpha_rad,beta_rad,gamma_rad,v_mm_s,omega_rad_s,\
             ref_x_mm,ref_y_mm,ref_z_mm,nearest,status,iterations,solve_us"
        );
        assert_eq!(row, "N8,1,0.1,,,0.30000000000000004,,,,,,,,,,,,");
    }
}
