//! Tables as binary PLY.

use super::table::{Cells, Column, Table};

/// Encodes a table as a vertex list of doubles, little endian.
///
/// `x_mm`, `y_mm` and `z_mm` become `x`, `y` and `z`; every other column keeps its name behind `scalar_`, the only way
/// in which CloudCompare keeps it and which Open3D, trimesh and PCL read as well. Labels are numbered, and a comment
/// tells what each number stands for.
pub(super) fn encode(table: &Table) -> Vec<u8> {
    let columns: Vec<(String, Vec<f64>)> = table.columns().iter().map(|c| (property(c.name), numbers(c))).collect();
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
            header += &format!("comment {} {number} = {line}\n", property(column.name));
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

fn numbers(column: &Column) -> Vec<f64> {
    match &column.cells {
        Cells::Whole(values) => values.iter().map(|&value| value as f64).collect(),
        Cells::Real(values, _) => values.clone(),
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
}
