// The way of a line through the VDI's pixels: a 2-D DDA over tiles, and over the pixels of those that may hold something.
// The pixels are those of cpu/walk.rs, which takes eight lines through them together.

// Sides of tiles per level, as powers of two.
const PIXELS: u32 = 0u;
const MIDDLE: u32 = 3u;
const COARSE: u32 = 5u;

// A walk over the tiles of one level, at a stretch inside one of them.
struct Level {
    x: Axis,
    y: Axis,
    // The stretch.
    start: f32,
    stop: f32,
    // Where the walk ends.
    end: f32,
}

fn level_at(line: Line, shift: u32, start: f32, end: f32, lo: vec2i, hi: vec2i) -> Level {
    let x = axis_at(line.start.x, line.change.x, line.per_change.x, shift, start, lo.x, hi.x);
    let y = axis_at(line.start.y, line.change.y, line.per_change.y, shift, start, lo.y, hi.y);
    return Level(x, y, start, min(min(x.next, y.next), end), end);
}

// Turns to the next tile; false behind the last one.
fn next_tile(level: ptr<function, Level>) -> bool {
    let l = *level;
    let x_first = l.x.next <= l.y.next;
    // A rim is met at the end at the earliest; rounding shall not lead beyond it.
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

// True if the tile holds something at the depths of the stretch.
fn is_met(line: Line, level: Level, shift: u32, first: u32) -> bool {
    if level.stop <= level.start {
        return false;
    }
    let width = ((stored.size.x - 1u) >> shift) + 1u;
    let mask = masks[first + u32(level.y.cell) * width + u32(level.x.cell)];
    let a = line.slab + level.start * line.slab_change;
    let b = line.slab + level.stop * line.slab_change;
    return any((mask & bits(slab(min(a, b) - line.margin), slab(max(a, b) + line.margin))) != vec2u(0u));
}

// First and last tile of the next finer level, 2^-`shift` as wide, inside a tile.
fn children(line: Line, level: Level, shift: u32, finer: u32) -> Level {
    let tile = vec2i(level.x.cell, level.y.cell);
    let last = vec2i((stored.size - 1u) >> vec2u(finer));
    let lo = tile << vec2u(shift);
    return level_at(line, finer, level.start, level.stop, lo, min(lo + ((1 << shift) - 1), last));
}

fn walk(line: Line) -> Light {
    var light = Light(vec3f(0.0), 1.0, 0u);
    let last = vec2i((stored.size - 1u) >> vec2u(COARSE));
    var coarse = level_at(line, COARSE, 0.0, 1.0, vec2i(0), last);
    loop {
        if is_met(line, coarse, COARSE, stored.first_masks.y) && walk_coarse(line, coarse, &light) {
            break;
        }
        if !next_tile(&coarse) {
            break;
        }
    }
    return light;
}

// True if nothing behind can be seen; so are the next two.
fn walk_coarse(line: Line, coarse: Level, light: ptr<function, Light>) -> bool {
    var middle = children(line, coarse, COARSE - MIDDLE, MIDDLE);
    loop {
        if is_met(line, middle, MIDDLE, stored.first_masks.x) && walk_middle(line, middle, light) {
            return true;
        }
        if !next_tile(&middle) {
            break;
        }
    }
    return false;
}

fn walk_middle(line: Line, middle: Level, light: ptr<function, Light>) -> bool {
    var pixels = children(line, middle, MIDDLE - PIXELS, PIXELS);
    loop {
        if is_met(line, pixels, PIXELS, 0u) {
            let pixel = u32(pixels.y.cell) * stored.size.x + u32(pixels.x.cell);
            if gather(line, pixel, pixels.start, pixels.stop, light) {
                return true;
            }
        }
        if !next_tile(&pixels) {
            break;
        }
    }
    return false;
}
