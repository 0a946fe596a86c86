//! Tables as binary PLY.

use anyhow::{Context, Result, bail};

use super::table::{Cells, Column, Table};

/// What every PLY file begins with.
pub(super) const MAGIC: &[u8] = b"ply";

/// Encodes a table as a vertex list of doubles, little endian.
///
/// `x_mm`, `y_mm` and `z_mm` become `x`, `y` and `z`; every other column keeps its name behind `scalar_`, the only way
/// in which CloudCompare keeps it and which Open3D, trimesh and PCL read as well. Labels are numbered, and a comment
/// tells what each number stands for.
pub(super) fn encode(table: &Table) -> Vec<u8> {
    let columns: Vec<(String, Vec<f64>)> = table.columns().iter().map(|c| (property(&c.name), numbers(c))).collect();
    let mut bytes = header(table, &columns).into_bytes();
    for row in 0..table.rows() {
        for (_, values) in &columns {
            bytes.extend_from_slice(&values[row].to_le_bytes());
        }
    }
    bytes
}

fn header(table: &Table, columns: &[(String, Vec<f64>)]) -> String {
    let mut header = "ply\nformat binary_little_endian 1.0\ncomment written by twinpupil; lengths in mm\n".to_owned();
    for column in table.columns() {
        for (number, label) in labels(column).iter().enumerate() {
            let line = label.split_whitespace().collect::<Vec<_>>().join(" ");
            header += &format!("comment {} {number} = {line}\n", property(&column.name));
        }
    }
    header += &format!("element vertex {}\n", table.rows());
    for (name, _) in columns {
        header += &format!("property double {name}\n");
    }
    header + "end_header\n"
}

fn property(name: &str) -> String {
    match name {
        "x_mm" | "y_mm" | "z_mm" => name[..1].to_owned(),
        other => format!("scalar_{other}"),
    }
}

/// The column that a property holds.
fn column(property: &str) -> String {
    match property {
        "x" | "y" | "z" => format!("{property}_mm"),
        other => other.strip_prefix("scalar_").unwrap_or(other).to_owned(),
    }
}

fn numbers(column: &Column) -> Vec<f64> {
    match &column.cells {
        Cells::Whole(values) => values.iter().map(|&value| value as f64).collect(),
        Cells::Real(values, _) | Cells::Scientific(values, _) => values.clone(),
        Cells::Flag(values) => values.iter().map(|&value| f64::from(u8::from(value))).collect(),
        Cells::Label(values) => {
            let labels = labels(column);
            values.iter().map(|value| labels.iter().position(|l| l == value).map_or(f64::NAN, |i| i as f64)).collect()
        }
    }
}

/// The different labels of a column in the order of their first appearance.
fn labels(column: &Column) -> Vec<&str> {
    let Cells::Label(values) = &column.cells else { return Vec::new() };
    let mut labels: Vec<&str> = Vec::new();
    for value in values {
        // Equal labels follow each other, frame by frame, so the search almost always ends at once.
        if !labels.iter().rev().any(|label| label == value) {
            labels.push(value);
        }
    }
    labels
}

/// Names of the columns, and every row as a text file would have it, from the vertices of a file such as [`encode`]
/// writes: binary, little endian, every property a double.
pub(super) fn decode(bytes: &[u8]) -> Result<(Vec<String>, Vec<Vec<String>>)> {
    const END: &[u8] = b"end_header\n";
    let end = bytes.windows(END.len()).position(|window| window == END).context("the PLY has no end of its header")?;
    let header = String::from_utf8_lossy(&bytes[..end]);
    let (columns, rows) = vertices(&header)?;
    let row_bytes = 8 * columns.len();
    let body = &bytes[end + END.len()..];
    if columns.is_empty() || body.len() / row_bytes < rows {
        bail!("the PLY is truncated");
    }
    let texts = |row: &[u8]| row.as_chunks().0.iter().map(|bytes| text(f64::from_le_bytes(*bytes))).collect();
    Ok((columns, body.chunks_exact(row_bytes).take(rows).map(texts).collect()))
}

/// Columns and number of the vertices.
fn vertices(header: &str) -> Result<(Vec<String>, usize)> {
    let (mut columns, mut rows) = (Vec::new(), None);
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["format", format, _] if format != "binary_little_endian" => {
                bail!("the PLY is {format}; legal: binary_little_endian")
            }
            ["element", "vertex", count] => rows = Some(count.parse().context("the PLY has no number of vertices")?),
            // What follows the vertices is of no interest, and what comes before them is of unknown length.
            ["element", ..] if rows.is_none() => bail!("the first element of the PLY is no vertex"),
            ["element", ..] => break,
            ["property", "double", name] => columns.push(column(name)),
            ["property", ..] => bail!("the PLY has `{line}`; legal: property double"),
            _ => {}
        }
    }
    Ok((columns, rows.context("the PLY has no vertices")?))
}

fn text(value: f64) -> String {
    if value.is_nan() { String::new() } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_a_header_and_doubles() {
        let table = Table::new()
            .with("x_mm", Cells::Real(vec![1.5, -2.0], 6))
            .with("id", Cells::Whole(vec![7, 8]))
            .with("frame", Cells::Label(vec!["a.png".to_owned(), "b.png".to_owned()]));
        let bytes = encode(&table);
        let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let expected = "ply\nformat binary_little_endian 1.0\ncomment written by twinpupil; lengths in mm\n\
            comment scalar_frame 0 = a.png\ncomment scalar_frame 1 = b.png\nelement vertex 2\n\
            property double x\nproperty double scalar_id\nproperty double scalar_frame\nend_header\n";
        assert_eq!(std::str::from_utf8(&bytes[..end]).unwrap(), expected);
        let doubles: Vec<f64> = bytes[end..].chunks(8).map(|c| f64::from_le_bytes(c.try_into().unwrap())).collect();
        assert_eq!(doubles, [1.5, 7.0, 0.0, -2.0, 8.0, 1.0]);
    }

    #[test]
    fn what_is_written_is_read_back() {
        let table = Table::new()
            .with("x_mm", Cells::Real(vec![0.1 + 0.2, f64::NAN], 6))
            .with("xz_cov_mm2", Cells::Scientific(vec![-1e-9, 1.0], 6))
            .with("overlapped", Cells::Flag(vec![true, false]));
        let bytes = encode(&table);
        let (columns, rows) = decode(&bytes).unwrap();
        assert_eq!(columns, ["x_mm", "xz_cov_mm2", "overlapped"]);
        assert_eq!(rows, [["0.30000000000000004", "-0.000000001", "1"], ["", "1", "0"]]);
        for length in [3, 40, bytes.len() - 1] {
            assert!(decode(&bytes[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn other_kinds_of_ply_are_refused() {
        let refusal = |header: &str| decode(format!("ply\n{header}end_header\n").as_bytes()).unwrap_err().to_string();
        assert_eq!(refusal("format ascii 1.0\n"), "the PLY is ascii; legal: binary_little_endian");
        assert_eq!(refusal("element face 3\n"), "the first element of the PLY is no vertex");
        assert_eq!(
            refusal("element vertex 1\nproperty float x\n"),
            "the PLY has `property float x`; legal: property double"
        );
        assert_eq!(refusal("element vertex 99999999\nproperty double x\n"), "the PLY is truncated");
    }
}
