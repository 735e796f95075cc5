//! Columns of equal length, and their Parquet files: flat, every column optional, compressed with snappy. Reading and writing go
//! column by column without Arrow.

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::column::writer::ColumnWriterImpl;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::{ParquetError, Result};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};
use std::io::Write;
use std::sync::Arc;

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cells {
    Whole(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
    Flag(Vec<Option<bool>>),
    Text(Vec<Option<String>>),
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) cells: Cells,
}

/// Columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Table {
    pub(super) columns: Vec<Column>,
}

impl Cells {
    fn len(&self) -> usize {
        match self {
            Self::Whole(cells) => cells.len(),
            Self::Number(cells) => cells.len(),
            Self::Flag(cells) => cells.len(),
            Self::Text(cells) => cells.len(),
        }
    }

    /// A cell in words; empty where there is no value.
    pub(super) fn words(&self, row: usize) -> String {
        fn word<T: ToString>(cells: &[Option<T>], row: usize) -> String {
            let cell = cells.get(row).and_then(Option::as_ref);
            cell.map_or(String::new(), T::to_string)
        }
        match self {
            Self::Whole(cells) => word(cells, row),
            Self::Number(cells) => word(cells, row),
            Self::Flag(cells) => word(cells, row),
            Self::Text(cells) => word(cells, row),
        }
    }

    fn clear(&mut self) {
        match self {
            Self::Whole(cells) => cells.clear(),
            Self::Number(cells) => cells.clear(),
            Self::Flag(cells) => cells.clear(),
            Self::Text(cells) => cells.clear(),
        }
    }

    /// Moves the cells of another column of the same kind here; false where the kinds differ.
    fn append(&mut self, other: &mut Self) -> bool {
        match (self, other) {
            (Self::Whole(cells), Self::Whole(more)) => cells.append(more),
            (Self::Number(cells), Self::Number(more)) => cells.append(more),
            (Self::Flag(cells), Self::Flag(more)) => cells.append(more),
            (Self::Text(cells), Self::Text(more)) => cells.append(more),
            _ => return false,
        }
        true
    }

    fn schema(&self, name: &str) -> Result<Type> {
        let (physical, logical) = match self {
            Self::Whole(_) => (Physical::INT64, None),
            Self::Number(_) => (Physical::DOUBLE, None),
            Self::Flag(_) => (Physical::BOOLEAN, None),
            Self::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()
    }
}

impl Table {
    /// Rows.
    pub(super) fn len(&self) -> usize {
        self.columns.first().map_or(0, |column| column.cells.len())
    }

    pub(super) fn clear(&mut self) {
        for column in &mut self.columns {
            column.cells.clear();
        }
    }

    /// The column of a name.
    pub(super) fn column(&self, name: &str) -> Option<&Cells> {
        let mut columns = self.columns.iter();
        columns.find(|column| column.name == name).map(|c| &c.cells)
    }

    /// Takes out the named columns, with a copy of the first column to tell the rows.
    pub(super) fn split_off(&mut self, names: &[&str]) -> Self {
        let (mut apart, left): (Vec<_>, Vec<_>) = std::mem::take(&mut self.columns)
            .into_iter()
            .partition(|column| names.contains(&column.name.as_str()));
        apart.splice(..0, left.first().cloned());
        self.columns = left;
        Self { columns: apart }
    }

    /// Numbers of a column; empty where there is no such column of numbers.
    pub(super) fn numbers(&self, name: &str) -> &[Option<f64>] {
        match self.column(name) {
            Some(Cells::Number(cells)) => cells,
            _ => &[],
        }
    }

    /// Whole numbers of a column; empty where there is no such column of whole numbers.
    pub(super) fn whole(&self, name: &str) -> &[Option<i64>] {
        match self.column(name) {
            Some(Cells::Whole(cells)) => cells,
            _ => &[],
        }
    }

    /// Appends the rows of a table with the same columns; false, with some columns appended, where they are others.
    #[must_use]
    pub(super) fn append(&mut self, other: &mut Self) -> bool {
        if self.columns.is_empty() {
            std::mem::swap(self, other);
            return true;
        }
        let names = |table: &Self| {
            table
                .columns
                .iter()
                .map(|c| c.name.clone())
                .collect::<Vec<_>>()
        };
        names(self) == names(other)
            && self
                .columns
                .iter_mut()
                .zip(&mut other.columns)
                .all(|(mine, more)| mine.cells.append(&mut more.cells))
    }

    /// The table as one Parquet file in memory.
    pub(super) fn to_parquet(&self) -> Result<Vec<u8>> {
        let mut writer = TableWriter::new(Vec::new(), self)?;
        writer.write(self)?;
        writer.finish()
    }

    /// Reads a Parquet file that this module wrote; rejects columns of other types.
    pub(super) fn from_parquet<R: ChunkReader + 'static>(source: R) -> Result<Self> {
        let reader = SerializedFileReader::new(source)?;
        let mut table = Self::default();
        for group in 0..reader.num_row_groups() {
            let group = reader.get_row_group(group)?;
            let rows = group.metadata().num_rows() as usize;
            let mut part = Self::default();
            for (i, column) in group.metadata().columns().iter().enumerate() {
                part.columns.push(Column {
                    name: column.column_descr().name().into(),
                    cells: read_cells(group.get_column_reader(i)?, rows)?,
                });
            }
            if !table.append(&mut part) {
                return Err(ParquetError::General("row groups differ".into()));
            }
        }
        Ok(table)
    }
}

fn read_cells(reader: ColumnReader, rows: usize) -> Result<Cells> {
    Ok(match reader {
        ColumnReader::Int64ColumnReader(reader) => Cells::Whole(read(reader, rows)?),
        ColumnReader::DoubleColumnReader(reader) => Cells::Number(read(reader, rows)?),
        ColumnReader::BoolColumnReader(reader) => Cells::Flag(read(reader, rows)?),
        ColumnReader::ByteArrayColumnReader(reader) => {
            let cells = read(reader, rows)?.into_iter();
            let text = |cell: ByteArray| Ok(cell.as_utf8()?.to_owned());
            Cells::Text(
                cells
                    .map(|cell| cell.map(text).transpose())
                    .collect::<Result<_>>()?,
            )
        }
        _ => {
            let message = "a column of a type that no campaign writes";
            return Err(ParquetError::General(message.into()));
        }
    })
}

fn read<T: DataType>(mut reader: ColumnReaderImpl<T>, rows: usize) -> Result<Vec<Option<T::T>>> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    while levels.len() < rows {
        let before = levels.len();
        reader.read_records(rows - before, Some(&mut levels), None, &mut values)?;
        if levels.len() == before {
            return Err(ParquetError::EOF("a column is too short".into()));
        }
    }
    let mut values = values.into_iter();
    Ok(levels
        .iter()
        .map(|level| if *level == 1 { values.next() } else { None })
        .collect())
}

/// Writes tables of the same columns one after another, a row group each.
pub(super) struct TableWriter<W: Write + Send>(SerializedFileWriter<W>);

impl<W: Write + Send> TableWriter<W> {
    /// A file with the columns of `table`, without its rows.
    pub(super) fn new(sink: W, table: &Table) -> Result<Self> {
        let fields: Result<Vec<TypePtr>> = table
            .columns
            .iter()
            .map(|column| column.cells.schema(&column.name).map(Arc::new))
            .collect();
        let schema = Type::group_type_builder("schema")
            .with_fields(fields?)
            .build()?;
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .build();
        SerializedFileWriter::new(sink, Arc::new(schema), Arc::new(properties)).map(Self)
    }

    /// Appends the rows of a table with the same columns.
    pub(super) fn write(&mut self, table: &Table) -> Result<()> {
        let mut group = self.0.next_row_group()?;
        for column in &table.columns {
            match &column.cells {
                Cells::Whole(cells) => write::<Int64Type, _>(&mut group, cells.iter().copied())?,
                Cells::Number(cells) => write::<DoubleType, _>(&mut group, cells.iter().copied())?,
                Cells::Flag(cells) => write::<BoolType, _>(&mut group, cells.iter().copied())?,
                Cells::Text(cells) => {
                    let bytes = |text: &String| ByteArray::from(text.as_str());
                    let cells = cells.iter().map(|text| text.as_ref().map(bytes));
                    write::<ByteArrayType, _>(&mut group, cells)?;
                }
            }
        }
        group.close()?;
        Ok(())
    }

    /// Completes the file and gives its sink back.
    pub(super) fn finish(self) -> Result<W> {
        self.0.into_inner()
    }
}

fn write<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    cells: impl Iterator<Item = Option<T::T>>,
) -> Result<()> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    for cell in cells {
        levels.push(i16::from(cell.is_some()));
        values.extend(cell);
    }
    let Some(mut column) = group.next_column()? else {
        return Err(ParquetError::General(
            "more columns than the file has".into(),
        ));
    };
    let writer: &mut ColumnWriterImpl<'_, T> = column.typed::<T>();
    writer.write_batch(&values, Some(&levels), None)?;
    column.close()
}
