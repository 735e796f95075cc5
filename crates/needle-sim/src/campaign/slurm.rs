//! A campaign as a Slurm job array: a task a shard, and a merge that waits for all of them.

use std::path::Path;

/// What the scripts need to know. Paths are written as they are: give absolute ones.
#[derive(Debug, Clone, Copy)]
pub struct SlurmArray<'a> {
    /// The program `needle`.
    pub program: &'a Path,
    /// The campaign file.
    pub file: &'a Path,
    /// Folder of the results, on a disk that all nodes see.
    pub folder: &'a Path,
    /// Tasks of the array, a shard each.
    pub tasks: u64,
    /// Threads of a task.
    pub threads: usize,
}

/// The scripts' names in the folder of the results.
pub const ARRAY_SCRIPT: &str = "array.sbatch";
/// The merge.
pub const MERGE_SCRIPT: &str = "merge.sbatch";
/// Submits both, the merge behind the array.
pub const SUBMIT_SCRIPT: &str = "submit.sh";

impl SlurmArray<'_> {
    /// The script of the array. A task that is killed and requeued goes on with the chunks that its shard lacks.
    #[must_use]
    pub fn array(&self) -> String {
        let Self { tasks, threads, .. } = self;
        format!(
            "#!/bin/bash\n\
             # A shard of the campaign a task; the same task run again computes only what is missing.\n\
             #SBATCH --job-name=needle-campaign\n\
             #SBATCH --array=1-{tasks}\n\
             #SBATCH --nodes=1\n\
             #SBATCH --ntasks=1\n\
             #SBATCH --cpus-per-task={threads}\n\
             #SBATCH --requeue\n\
             #SBATCH --open-mode=append\n\
             #SBATCH --output=slurm-%A_%a.log\n\
             set -euo pipefail\n\
             exec {program} campaign {file} --out {folder} --shard \"$SLURM_ARRAY_TASK_ID/{tasks}\" --threads {threads}\n",
            program = quoted(self.program),
            file = quoted(self.file),
            folder = quoted(self.folder),
        )
    }

    /// The script of the merge.
    #[must_use]
    pub fn merge(&self) -> String {
        format!(
            "#!/bin/bash\n\
             #SBATCH --job-name=needle-merge\n\
             #SBATCH --nodes=1\n\
             #SBATCH --ntasks=1\n\
             #SBATCH --cpus-per-task=1\n\
             #SBATCH --requeue\n\
             #SBATCH --output=slurm-merge-%j.log\n\
             set -euo pipefail\n\
             exec {program} merge {folder}\n",
            program = quoted(self.program),
            folder = quoted(self.folder),
        )
    }

    /// The script that submits both; arguments go to both `sbatch` calls (partition, account, time limit).
    #[must_use]
    pub fn submit(&self) -> String {
        format!(
            "#!/bin/bash\n\
             # Arguments go to sbatch: bash {SUBMIT_SCRIPT} --partition=long --time=2:00:00\n\
             set -euo pipefail\n\
             cd {folder}\n\
             array=$(sbatch --parsable \"$@\" {ARRAY_SCRIPT})\n\
             array=${{array%%;*}}\n\
             merge=$(sbatch --parsable --dependency=\"afterok:$array\" --kill-on-invalid-dep=yes \"$@\" {MERGE_SCRIPT})\n\
             echo \"array $array, merge ${{merge%%;*}}\"\n",
            folder = quoted(self.folder),
        )
    }
}

/// A path as one word of a shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.to_string_lossy().replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_with_blanks_and_quotes_stay_one_word() {
        let path = Path::new("/data/it's here/$HOME `x`");
        assert_eq!(quoted(path), r"'/data/it'\''s here/$HOME `x`'");
    }
}
