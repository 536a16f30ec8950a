// Exclusive prefix sums in place: of blocks of 1024 first, then of the blocks' sums likewise, which are then added to the blocks.

@group(0) @binding(0) var<uniform> scan: ScanUniforms;
@group(0) @binding(1) var<storage, read_write> data: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

const LANES: u32 = 256u;
const PER_LANE: u32 = 4u;

var<workgroup> shared_sums: array<u32, 256>;

@compute @workgroup_size(256)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = (block * LANES + lane) * PER_LANE;
    var own = 0u;
    for (var n = first; n < min(first + PER_LANE, scan.count); n++) {
        own += data[n];
    }
    shared_sums[lane] = own;
    // Hillis-Steele scan: each lane adds the sum `reach` lanes before it, with `reach` doubling.
    for (var reach = 1u; reach < LANES; reach *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if lane >= reach {
            before = shared_sums[lane - reach];
        }
        workgroupBarrier();
        shared_sums[lane] += before;
    }
    var sum = shared_sums[lane] - own;
    for (var n = first; n < min(first + PER_LANE, scan.count); n++) {
        let count = data[n];
        data[n] = sum;
        sum += count;
    }
    if lane == LANES - 1u && block < scan.blocks {
        sums[block] = sum;
    }
}

@compute @workgroup_size(256)
fn add_sums(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = (block * LANES + lane) * PER_LANE;
    for (var n = first; n < min(first + PER_LANE, scan.count); n++) {
        data[n] += sums[block];
    }
}
