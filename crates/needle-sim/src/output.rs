//! Files that appear under their final name whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Why a file or folder could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The folder cannot be made, or takes no files.
    #[error("cannot write to the folder {}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Makes `path` and its parents, and finds out whether files can be made there.
///
/// # Errors
/// [`OutputError::Folder`].
pub fn make_folder(path: &Path) -> Result<(), OutputError> {
    fs::create_dir_all(path)
        .and_then(|()| NamedTempFile::new_in(path).map_err(|error| error.kind().into()))
        .map(drop)
        .map_err(|source| OutputError::Folder {
            path: path.into(),
            source,
        })
}

/// Writes `contents` beside `path` and moves it there: a reader, a full disk or an interrupt never meets half a file.
///
/// # Errors
/// [`OutputError::File`]; the file is then as it was.
pub fn write_whole(path: &Path, contents: &[u8]) -> Result<(), OutputError> {
    let written = (|| {
        // The parent of a bare name is empty.
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let mut file = NamedTempFile::new_in(folder)?;
        file.write_all(contents)?;
        file.as_file().sync_all()?;
        make_readable(&file)?;
        file.persist(path)?;
        Ok(())
    })();
    // The kind alone: the whole error names the temporary file, which means nothing to a reader.
    written.map_err(|error: io::Error| OutputError::File {
        path: path.into(),
        source: error.kind().into(),
    })
}

/// A temporary file is private to its owner; data files are for everyone.
#[cfg(unix)]
pub(crate) fn make_readable(file: &NamedTempFile) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.as_file()
        .set_permissions(fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
pub(crate) fn make_readable(_: &NamedTempFile) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        // A folder stands where the file should go, so the last step fails.
        let path = folder.path().join("taken");
        fs::create_dir_all(path.join("full")).unwrap();
        assert!(matches!(
            write_whole(&path, b"data"),
            Err(OutputError::File { .. })
        ));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_second_write_replaces_the_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file.csv");
        write_whole(&path, b"a longer first version").unwrap();
        write_whole(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
    }
}
