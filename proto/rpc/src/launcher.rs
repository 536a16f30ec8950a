//! Rank and number of ranks of this process, from the environment of the MPI launcher that started it.

/// Variables of launchers: rank, ranks. Slurm's are those of a job step: a batch script itself is no rank.
const VARIABLES: [[&str; 2]; 4] = [
    ["OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"],
    ["PMI_RANK", "PMI_SIZE"],
    ["MV2_COMM_WORLD_RANK", "MV2_COMM_WORLD_SIZE"],
    ["SLURM_PROCID", "SLURM_STEP_NUM_TASKS"],
];

/// Rank and ranks of MPI_COMM_WORLD, if a launcher of Open MPI, MPICH and its kin, or Slurm started this process.
pub fn launched_rank() -> Option<(u32, u32)> {
    rank_in(|name| std::env::var(name).ok())
}

fn rank_in(variable: impl Fn(&str) -> Option<String>) -> Option<(u32, u32)> {
    let number = |name| variable(name)?.parse().ok();
    VARIABLES
        .iter()
        .find_map(|[rank, ranks]| Some((number(rank)?, number(ranks)?)))
        .filter(|(rank, ranks)| rank < ranks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_launchers_own_variables_come_before_the_schedulers() {
        let of = |set: &[(&str, &str)]| {
            rank_in(|name| set.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned()))
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[("OMPI_COMM_WORLD_RANK", "2"), ("OMPI_COMM_WORLD_SIZE", "3")]), Some((2, 3)));
        let slurm = [("SLURM_PROCID", "5"), ("SLURM_STEP_NUM_TASKS", "8")];
        assert_eq!(of(&slurm), Some((5, 8)));
        // mpirun of MPICH inside of one task of a job.
        assert_eq!(of(&[slurm[0], slurm[1], ("PMI_RANK", "1"), ("PMI_SIZE", "4")]), Some((1, 4)));
        // A batch script is no rank, and half of what is needed is nothing.
        assert_eq!(of(&[("SLURM_PROCID", "0"), ("SLURM_NTASKS", "8")]), None);
        assert_eq!(of(&[("PMI_RANK", "4"), ("PMI_SIZE", "4")]), None);
        assert_eq!(of(&[("PMI_RANK", "x"), ("PMI_SIZE", "4"), slurm[0], slurm[1]]), Some((5, 8)));
    }
}
