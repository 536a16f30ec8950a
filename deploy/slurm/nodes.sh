# Sourced by the batch scripts. Needs lamina, generator-node, viz-node and tuner on the PATH.
# Where the nodes listen follows from the job alone: the first host of LAMINA_NODELIST (of the allocation, if that is empty), and three ports from its number. Nothing is written that could be
# read when it is old.
lamina_host() { scontrol show hostnames "${LAMINA_NODELIST:-$SLURM_JOB_NODELIST}" | head -1; }
lamina_port() { echo $((20000 + SLURM_JOB_ID % 10000 * 3 + $1)); }

# lamina_start FOLDER [SRUN OPTIONS]: the nodes on the first host of the allocation, beside what else runs there; a group of
# generator-nodes, LAMINA_MEMBERS of them, if that is over 1. Sets LAMINA_GENERATOR for the simulation.
lamina_start() {
    local folder="$1"
    shift
    mkdir -p "$folder"
    local host
    host=$(lamina_host)
    # Keys of this job alone: other users of its hosts reach the ports, too.
    lamina keys "$folder/keys" --days 30 --host "$host"
    export LAMINA_GENERATOR="https://$host:$(lamina_port 0)" LAMINA_CREDENTIALS="$folder/keys/simulation"
    printf 'store = "%s/runs"\n' "$folder" >"$folder/viz-node.toml"
    printf 'contract = "%s"\n' "${LAMINA_CONTRACT:-size <= 200kB}" >"$folder/tuner.toml"
    local group=()
    [ "${LAMINA_MEMBERS:-1}" -gt 1 ] && group=(--group)
    srun --overlap "$@" --ntasks="${LAMINA_MEMBERS:-1}" --job-name=generator-node \
        generator-node "${group[@]}" --listen "0.0.0.0:$(lamina_port 0)" --credentials "$folder/keys/generator" &
    srun --overlap "$@" --nodelist="$host" --nodes=1 --ntasks=1 --job-name=viz-node \
        viz-node --listen "0.0.0.0:$(lamina_port 1)" --credentials "$folder/keys/viewer" --generator "$LAMINA_GENERATOR" --config "$folder/viz-node.toml" &
    srun --overlap "$@" --nodelist="$host" --nodes=1 --ntasks=1 --job-name=tuner \
        tuner --listen "0.0.0.0:$(lamina_port 2)" --credentials "$folder/keys/tuner" --generator "$LAMINA_GENERATOR" --config "$folder/tuner.toml" &
}

# lamina_stop: ends the nodes' steps once what they have is recorded.
lamina_stop() {
    sleep "${LAMINA_LINGER:-3}"
    local step
    for step in $(squeue --steps --noheader --format='%i %j' --jobs="$SLURM_JOB_ID${SLURM_JOB_ID_HET_GROUP_1:+,$SLURM_JOB_ID_HET_GROUP_1}" | awk '$2 ~ /^(generator-node|viz-node|tuner)$/ { print $1 }'); do
        scancel --signal=TERM "$step"
    done
    wait
}
