//! `needle campaign --slurm`: the scripts of a job array, written beside the results.

use super::campaign::Args;
use crate::answer::{CliError, Verdict, print};
use needle_sim::campaign::{ARRAY_SCRIPT, Campaign, MERGE_SCRIPT, SUBMIT_SCRIPT, SlurmArray};
use needle_sim::output::{make_folder, write_whole};
use std::path::{Path, PathBuf};

pub(super) fn write(
    campaign: &Campaign,
    args: &Args,
    folder: &Path,
    tasks: u64,
) -> Result<Verdict, CliError> {
    make_folder(folder)?;
    let program = std::env::current_exe().map_err(CliError::Program)?;
    let scripts = SlurmArray {
        program: &program,
        file: &absolute(args.file())?,
        folder: &absolute(folder)?,
        tasks,
        // A task asks for as many cores as it has threads; 0 has no meaning there.
        threads: args.threads().max(1),
    };
    for (name, text) in [
        (ARRAY_SCRIPT, scripts.array()),
        (MERGE_SCRIPT, scripts.merge()),
        (SUBMIT_SCRIPT, scripts.submit()),
    ] {
        write_whole(&folder.join(name), text.as_bytes())?;
    }
    print(&format!(
        "{} runs in {tasks} tasks; submit with: bash {}\n",
        campaign.runs(),
        folder.join(SUBMIT_SCRIPT).display()
    ))?;
    Ok(Verdict::Yes)
}

fn absolute(path: &Path) -> Result<PathBuf, CliError> {
    std::path::absolute(path).map_err(CliError::Program)
}
