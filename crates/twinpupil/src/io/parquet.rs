//! Tables as Parquet: every column with its type, `null` for what is unknown.

use std::panic::{self, UnwindSafe};
use std::sync::Arc;

use anyhow::{Context, Result};
use bytes::Bytes;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::record::Field;
use parquet::schema::types::{Type, TypePtr};

use super::table::{Cells, Column, Table};

/// What every Parquet file begins and ends with.
pub(super) const MAGIC: &[u8] = b"PAR1";

/// Encodes a table as one row group: whole numbers as INT64, numbers as DOUBLE, flags as BOOLEAN and words as UTF-8
/// strings. Only numbers may be null.
pub(super) fn encode(table: &Table) -> Result<Vec<u8>> {
    encode_with_notes(table, &[])
}

/// The same, with notes beside the table: a key and a text each.
pub(super) fn encode_with_notes(table: &Table, notes: &[(&str, String)]) -> Result<Vec<u8>> {
    written(table, notes).context("cannot be encoded as Parquet")
}

fn written(table: &Table, notes: &[(&str, String)]) -> Result<Vec<u8>, ParquetError> {
    let created_by = format!("twinpupil version {}", env!("CARGO_PKG_VERSION"));
    let notes: Vec<KeyValue> = notes.iter().map(|(key, text)| KeyValue::new((*key).to_owned(), text.clone())).collect();
    let notes = Some(notes).filter(|notes| !notes.is_empty());
    let properties = WriterProperties::builder().set_created_by(created_by).set_key_value_metadata(notes).build();
    let mut file = SerializedFileWriter::new(Vec::new(), schema(table)?, Arc::new(properties))?;
    let mut rows = file.next_row_group()?;
    for column in table.columns() {
        if let Some(mut writer) = rows.next_column()? {
            write(&mut writer, &column.cells)?;
            writer.close()?;
        }
    }
    rows.close()?;
    file.into_inner()
}

fn schema(table: &Table) -> Result<TypePtr, ParquetError> {
    let fields = table.columns().iter().map(|column| field(column).map(Arc::new)).collect::<Result<_, _>>()?;
    Type::group_type_builder("twinpupil").with_fields(fields).build().map(Arc::new)
}

fn field(column: &Column) -> Result<Type, ParquetError> {
    let (physical, logical, repetition) = match column.cells {
        Cells::Whole(_) => (Physical::INT64, None, Repetition::REQUIRED),
        Cells::Real(..) | Cells::Scientific(..) => (Physical::DOUBLE, None, Repetition::OPTIONAL),
        Cells::Flag(_) => (Physical::BOOLEAN, None, Repetition::REQUIRED),
        Cells::Label(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::REQUIRED),
    };
    let builder = Type::primitive_type_builder(&column.name, physical);
    builder.with_logical_type(logical).with_repetition(repetition).build()
}

fn write(writer: &mut SerializedColumnWriter<'_>, cells: &Cells) -> Result<(), ParquetError> {
    match cells {
        Cells::Whole(values) => writer.typed::<Int64Type>().write_batch(values, None, None),
        Cells::Real(values, _) | Cells::Scientific(values, _) => {
            // A level of 0 stands for null, and only what is not null is among the values.
            let levels: Vec<i16> = values.iter().map(|value| i16::from(value.is_finite())).collect();
            let known: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
            writer.typed::<DoubleType>().write_batch(&known, Some(&levels), None)
        }
        Cells::Flag(values) => writer.typed::<BoolType>().write_batch(values, None, None),
        Cells::Label(values) => {
            let words: Vec<ByteArray> = values.iter().map(|value| ByteArray::from(value.as_str())).collect();
            writer.typed::<ByteArrayType>().write_batch(&words, None, None)
        }
    }
    .map(|_| ())
}

/// Names of the columns, and every row as a text file would have it.
pub(super) fn decode(bytes: Vec<u8>) -> Result<(Vec<String>, Vec<Vec<String>>)> {
    guarded(|| read(bytes)).context("the Parquet file cannot be read")
}

/// The text of the note under a key, if the file has one.
pub(super) fn note(bytes: Vec<u8>, key: &str) -> Result<Option<String>> {
    let read = || {
        let reader = SerializedFileReader::new(Bytes::from(bytes))?;
        let notes = reader.metadata().file_metadata().key_value_metadata();
        Ok(notes.into_iter().flatten().find(|note| note.key == key).and_then(|note| note.value.clone()))
    };
    guarded(read).context("the Parquet file cannot be read")
}

/// Makes a panic of the crate an error: damaged metadata can have it find a length below zero.
fn guarded<T>(read: impl FnOnce() -> Result<T, ParquetError> + UnwindSafe) -> Result<T, ParquetError> {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let outcome = panic::catch_unwind(read);
    panic::set_hook(hook);
    outcome.unwrap_or_else(|_| Err(ParquetError::General("it is damaged".to_owned())))
}

fn read(bytes: Vec<u8>) -> Result<(Vec<String>, Vec<Vec<String>>), ParquetError> {
    let reader = SerializedFileReader::new(Bytes::from(bytes))?;
    let schema = reader.metadata().file_metadata().schema();
    let header = schema.get_fields().iter().map(|field| field.name().to_owned()).collect();
    let texts = |row: parquet::record::Row| row.get_column_iter().map(|(_, field)| text(field)).collect();
    let rows = reader.get_row_iter(None)?.map(|row| row.map(texts)).collect::<Result<_, _>>()?;
    Ok((header, rows))
}

/// A value as the text that reads back to it; nothing for null.
fn text(field: &Field) -> String {
    match field {
        Field::Null => String::new(),
        Field::Bool(value) => u8::from(*value).to_string(),
        Field::Float(value) if value.is_nan() => String::new(),
        Field::Double(value) if value.is_nan() => String::new(),
        Field::Float(value) => value.to_string(),
        Field::Double(value) => value.to_string(),
        Field::Str(value) => value.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        Table::new()
            .with("id", Cells::Whole(vec![i64::MAX, -2]))
            .with("z_mm", Cells::Real(vec![0.1 + 0.2, f64::NAN], 6))
            .with("xz_cov_mm2", Cells::Scientific(vec![f64::INFINITY, -1.0e-12], 6))
            .with("overlapped", Cells::Flag(vec![true, false]))
            .with("frame", Cells::Label(vec!["a.png".to_owned(), "ä.png".to_owned()]))
    }

    #[test]
    fn what_is_written_is_read_back_to_the_last_bit() {
        let bytes = encode(&table()).unwrap();
        assert!(bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC));
        let (header, rows) = decode(bytes).unwrap();
        assert_eq!(header, ["id", "z_mm", "xz_cov_mm2", "overlapped", "frame"]);
        assert_eq!(rows[0], ["9223372036854775807", "0.30000000000000004", "", "1", "a.png"]);
        assert_eq!(rows[1], ["-2", "", "-0.000000000001", "0", "ä.png"]);
    }

    #[test]
    fn notes_are_read_back_by_their_key() {
        let bytes = encode_with_notes(&table(), &[("a", "x\n{y}".to_owned()), ("b", String::new())]).unwrap();
        let read = |key: &str| note(bytes.clone(), key).unwrap();
        assert_eq!((read("a").as_deref(), read("b").as_deref(), read("c")), (Some("x\n{y}"), Some(""), None));
        assert_eq!(decode(bytes).unwrap(), decode(encode(&table()).unwrap()).unwrap());
    }

    #[test]
    fn columns_have_their_types() {
        let reader = SerializedFileReader::new(Bytes::from(encode(&table()).unwrap())).unwrap();
        let types: Vec<(Physical, bool)> = reader
            .metadata()
            .file_metadata()
            .schema()
            .get_fields()
            .iter()
            .map(|field| (field.get_physical_type(), field.is_optional()))
            .collect();
        let expected = [
            (Physical::INT64, false),
            (Physical::DOUBLE, true),
            (Physical::DOUBLE, true),
            (Physical::BOOLEAN, false),
            (Physical::BYTE_ARRAY, false),
        ];
        assert_eq!(types, expected);
    }

    #[test]
    fn a_table_without_rows_keeps_its_columns() {
        let table = Table::new().with("id", Cells::Whole(vec![])).with("z_mm", Cells::Real(vec![], 6));
        let (header, rows) = decode(encode(&table).unwrap()).unwrap();
        assert_eq!((header.len(), rows.len()), (2, 0));
    }

    #[test]
    fn a_truncated_file_is_an_error() {
        let bytes = encode(&table()).unwrap();
        for length in [4, 12, bytes.len() / 2, bytes.len() - 1] {
            assert!(decode(bytes[..length].to_vec()).is_err(), "{length}");
        }
    }

    #[test]
    fn no_damage_is_a_panic() {
        let bytes = encode(&table()).unwrap();
        let mut errors = 0;
        for place in 0..bytes.len() {
            for value in [0x00, 0x01, 0x7f, 0x80, 0xff] {
                let mut damaged = bytes.clone();
                damaged[place] = value;
                errors += usize::from(decode(damaged).is_err());
            }
        }
        assert!(errors > bytes.len(), "{errors}");
        let why = guarded::<()>(|| panic!("by the crate")).unwrap_err();
        assert_eq!(why.to_string(), "Parquet error: it is damaged");
    }
}
