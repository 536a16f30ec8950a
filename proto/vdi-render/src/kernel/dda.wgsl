// Traversal of the VDI's pixels along one ray: a hierarchical 2-D DDA over tiles, and over the pixels of tiles that may hold
// something at the ray's depth. Visits the pixels that simd/dda.rs visits, which takes eight lines through them together.

// Sides of tiles per level, as powers of two.
const PIXELS: u32 = 0u;
const MIDDLE: u32 = 3u;
const COARSE: u32 = 5u;

// State of a walk over the tiles of one level, at the part of the ray inside one of them.
struct LevelWalk {
    x: AxisWalk,
    y: AxisWalk,
    // Ends of that part, as positions mu.
    start: f32,
    stop: f32,
    // End of the walk.
    end: f32,
}

fn level_at(line: ImageLine, shift: u32, start: f32, end: f32, lo: vec2i, hi: vec2i) -> LevelWalk {
    let x = axis_at(line.start.x, line.change.x, line.per_change.x, shift, start, lo.x, hi.x);
    let y = axis_at(line.start.y, line.change.y, line.per_change.y, shift, start, lo.y, hi.y);
    return LevelWalk(x, y, start, min(min(x.next, y.next), end), end);
}

// Advances to the next tile; false behind the last one.
fn next_tile(level: ptr<function, LevelWalk>) -> bool {
    let l = *level;
    let x_first = l.x.next <= l.y.next;
    // The last tile of an axis is left at the end only, whatever rounding says.
    let at_rim = select(l.y.cell == l.y.last, l.x.cell == l.x.last, x_first);
    if l.stop >= l.end || at_rim {
        return false;
    }
    (*level).start = l.stop;
    if x_first {
        (*level).x = advanced(l.x);
    } else {
        (*level).y = advanced(l.y);
    }
    (*level).stop = min(min((*level).x.next, (*level).y.next), l.end);
    return true;
}

// True if the tile holds something in the depth bins that the ray crosses in it.
fn is_met(line: ImageLine, level: LevelWalk, shift: u32, first: u32) -> bool {
    if level.stop <= level.start {
        return false;
    }
    let width = ((stored.size.x - 1u) >> shift) + 1u;
    let mask = masks[first + u32(level.y.cell) * width + u32(level.x.cell)];
    let a = line.bin + level.start * line.bin_change;
    let b = line.bin + level.stop * line.bin_change;
    return any((mask & bits(bin(min(a, b) - line.margin), bin(max(a, b) + line.margin))) != vec2u(0u));
}

// A walk over the next finer level, whose tiles are 2^-`shift` as wide, inside a tile.
fn children(line: ImageLine, level: LevelWalk, shift: u32, finer: u32) -> LevelWalk {
    let tile = vec2i(level.x.cell, level.y.cell);
    let last = vec2i((stored.size - 1u) >> vec2u(finer));
    let lo = tile << vec2u(shift);
    return level_at(line, finer, level.start, level.stop, lo, min(lo + ((1 << shift) - 1), last));
}

fn trace(line: ImageLine) -> LineAccumulator {
    var light = LineAccumulator(vec3f(0.0), 1.0, 0u);
    let last = vec2i((stored.size - 1u) >> vec2u(COARSE));
    if line.visible.x >= line.visible.y {
        return light;
    }
    var coarse = level_at(line, COARSE, line.visible.x, line.visible.y, vec2i(0), last);
    loop {
        if is_met(line, coarse, COARSE, stored.first_masks.y) && trace_coarse(line, coarse, &light) {
            break;
        }
        if !next_tile(&coarse) {
            break;
        }
    }
    return light;
}

// Walks the middle tiles of a coarse one; true if the ray has become opaque.
fn trace_coarse(line: ImageLine, coarse: LevelWalk, light: ptr<function, LineAccumulator>) -> bool {
    var middle = children(line, coarse, COARSE - MIDDLE, MIDDLE);
    loop {
        if is_met(line, middle, MIDDLE, stored.first_masks.x) && trace_middle(line, middle, light) {
            return true;
        }
        if !next_tile(&middle) {
            break;
        }
    }
    return false;
}

fn trace_middle(line: ImageLine, middle: LevelWalk, light: ptr<function, LineAccumulator>) -> bool {
    var pixels = children(line, middle, MIDDLE - PIXELS, PIXELS);
    loop {
        if is_met(line, pixels, PIXELS, 0u) {
            let pixel = u32(pixels.y.cell) * stored.size.x + u32(pixels.x.cell);
            if composite_list(line, pixel, pixels.start, pixels.stop, light) {
                return true;
            }
        }
        if !next_tile(&pixels) {
            break;
        }
    }
    return false;
}
