//! Movies of recorded steps: through time, around the data, or both.
//!
//! Animated WebP is written here, its frames lossless; MP4 by ffmpeg, where that is installed.

use anyhow::{Context, bail, ensure};
use image_webp::{ColorType, WebPEncoder};
use lamina_model::Image;
use lamina_vdi_render::{Backend, Detail, Drawable};
use lamina_volume_io::read_recorded;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};

/// What a movie shows.
pub(crate) struct Movie {
    /// Pictures; steps are spread evenly over them.
    pub frames: u32,
    /// By how much the camera turns about the data from the first to behind the last, degrees; its elevation, degrees.
    pub turn: f64,
    pub elevation: f64,
    /// Pictures a second.
    pub rate: u32,
    /// Pixels a side.
    pub size: u32,
}

/// Draws `movie` of the steps in some files and writes it to `out`, a `.webp` or `.mp4`: whole, or what was there stays.
pub(crate) fn write(out: &Path, steps: &[&Path], movie: &Movie, backend: &Backend) -> anyhow::Result<()> {
    let name = out.file_name().with_context(|| format!("{}: is no name of a file", out.display()))?;
    let unfinished = out.with_file_name(format!("unfinished-{}", name.to_string_lossy()));
    let written = draw(&unfinished, steps, movie, backend).and_then(|()| {
        std::fs::rename(&unfinished, out).with_context(|| format!("{}: cannot be written", out.display()))
    });
    if written.is_err() {
        let _ = std::fs::remove_file(&unfinished);
    }
    written
}

fn draw(out: &Path, steps: &[&Path], movie: &Movie, backend: &Backend) -> anyhow::Result<()> {
    let &Movie { frames, turn, elevation, rate, size } = movie;
    Image::check_size(size, size)?;
    let mut sink: Box<dyn Sink> = match out.extension().is_some_and(|e| e.eq_ignore_ascii_case("mp4")) {
        true => Box::new(Ffmpeg::start(out, size, rate)?),
        false => Box::new(WebP::create(out, size, 1000 / rate)?),
    };
    let mut shown: Option<(usize, Drawable)> = None;
    for n in 0..frames {
        let at = (n as usize * steps.len()) / frames as usize;
        let drawable = match shown.take() {
            Some((of, drawable)) if of == at => drawable,
            _ => Drawable::new(read_recorded(steps[at])?),
        };
        let camera = drawable.camera().orbit(turn * f64::from(n) / f64::from(frames), elevation, 1.0)?;
        sink.add(&backend.render(&drawable, &camera, size, size, Detail::Cubic)?.to_rgb8())?;
        shown = Some((at, drawable));
    }
    sink.finish()
}

/// Where pictures go, one after the other: rows of red, green and blue.
trait Sink {
    fn add(&mut self, rgb: &[u8]) -> anyhow::Result<()>;
    fn finish(self: Box<Self>) -> anyhow::Result<()>;
}

/// The encoder of another project, at work.
struct Ffmpeg {
    process: Child,
    pictures: Option<ChildStdin>,
}

/// One that has not ended by itself is ended: a picture could not be drawn.
impl Drop for Ffmpeg {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Ffmpeg {
    fn start(out: &Path, size: u32, rate: u32) -> anyhow::Result<Self> {
        ensure!(size.is_multiple_of(2), "--size {size}: an .mp4 needs an even number of pixels");
        let (size, rate) = (format!("{size}x{size}"), rate.to_string());
        let raw = ["-f", "rawvideo", "-pixel_format", "rgb24", "-video_size", &size, "-framerate", &rate, "-i", "-"];
        // Chroma at half the resolution is what all players know; a quality of 18 is hard to tell from lossless.
        let coded = ["-pix_fmt", "yuv420p", "-crf", "18", "-movflags", "+faststart"];
        let mut command = Command::new("ffmpeg");
        command.args(["-loglevel", "error", "-y"]).args(raw).args(coded).arg(out).stdin(Stdio::piped());
        let mut process = command.spawn().map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => {
                anyhow::anyhow!("{}: there is no ffmpeg here; install it, or name a .webp", out.display())
            }
            _ => anyhow::Error::new(error).context("ffmpeg cannot be started"),
        })?;
        let pictures = process.stdin.take();
        Ok(Self { process, pictures })
    }
}

impl Sink for Ffmpeg {
    fn add(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        let pictures = self.pictures.as_mut().context("ffmpeg takes no input")?;
        pictures.write_all(rgb).context("ffmpeg ended; what it says of it is above")
    }

    fn finish(mut self: Box<Self>) -> anyhow::Result<()> {
        // The end of its input.
        self.pictures = None;
        let status = self.process.wait()?;
        ensure!(status.success(), "ffmpeg: {status}; what it says of it is above");
        Ok(())
    }
}

/// An animated WebP: RIFF chunks `VP8X`, `ANIM`, and an `ANMF` for each picture (WebP Container Specification).
struct WebP {
    file: BufWriter<File>,
    size: u32,
    /// Of each picture, milliseconds.
    duration: u32,
    /// Of the file, so far.
    bytes: u64,
}

impl WebP {
    fn create(out: &Path, size: u32, duration: u32) -> anyhow::Result<Self> {
        ensure!(size <= 1 << 14, "--size {size}: a .webp has at most {} pixels a side", 1 << 14);
        let file = File::create(out).with_context(|| format!("{}: cannot be written", out.display()))?;
        let mut webp = Self { file: BufWriter::new(file), size, duration, bytes: 0 };
        // The file's length stands in front, and is known in the end.
        webp.file.write_all(b"RIFF\0\0\0\0WEBP")?;
        webp.bytes = 12;
        let side = u24(size - 1);
        // Its only feature is animation.
        webp.chunk(*b"VP8X", &[&[0x02, 0, 0, 0], &side[..], &side[..]].concat())?;
        // Black behind, and again from the beginning for ever.
        webp.chunk(*b"ANIM", &[0; 6])?;
        Ok(webp)
    }

    fn chunk(&mut self, name: [u8; 4], data: &[u8]) -> anyhow::Result<()> {
        let padding = data.len() % 2;
        self.file.write_all(&name)?;
        self.file.write_all(&u32::try_from(data.len())?.to_le_bytes())?;
        self.file.write_all(data)?;
        self.file.write_all(&[0][..padding])?;
        self.bytes += (8 + data.len() + padding) as u64;
        Ok(())
    }
}

impl Sink for WebP {
    fn add(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        let mut picture = Vec::new();
        WebPEncoder::new(&mut picture).encode(rgb, self.size, self.size, ColorType::Rgb8)?;
        let Some(lossless) = picture.get(12..).filter(|chunk| chunk.starts_with(b"VP8L")) else {
            bail!("a picture was coded in a way that an animation does not hold");
        };
        let side = u24(self.size - 1);
        // At the upper left; in place of the one before, not over it.
        let head = [&[0; 6], &side[..], &side[..], &u24(self.duration), &[0x02]].concat();
        self.chunk(*b"ANMF", &[&head, lossless].concat())
    }

    fn finish(mut self: Box<Self>) -> anyhow::Result<()> {
        let size = u32::try_from(self.bytes - 8).context("a .webp holds 4 GiB; make it smaller, or an .mp4")?;
        self.file.seek(SeekFrom::Start(4))?;
        self.file.write_all(&size.to_le_bytes())?;
        Ok(self.file.flush()?)
    }
}

fn u24(n: u32) -> [u8; 3] {
    let [a, b, c, _] = n.to_le_bytes();
    [a, b, c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use image_webp::{LoopCount, WebPDecoder};

    #[test]
    fn a_movie_of_a_step_that_cannot_be_read_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("x.webp");
        std::fs::write(&out, "an earlier movie").unwrap();
        let movie = Movie { frames: 2, turn: 0.0, elevation: 0.0, rate: 25, size: 16 };
        let error = write(&out, &[Path::new("/missing.vdi")], &movie, &Backend::default()).unwrap_err();
        assert!(format!("{error:#}").contains("/missing.vdi"), "{error:#}");
        assert_eq!(std::fs::read(&out).unwrap(), b"an earlier movie");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing unfinished stays");
    }

    #[test]
    fn an_independent_decoder_reads_each_picture_of_an_animated_webp_exactly() {
        let folder = tempfile::tempdir().unwrap();
        // An odd number of bytes in some chunks, whatever the coder makes of it.
        for size in [1, 7, 16] {
            let out = folder.path().join("x.webp");
            let picture = |n: u32| -> Vec<u8> { (0..3 * size * size).map(|i| (i * (n + 3) % 251) as u8).collect() };
            let mut webp = Box::new(WebP::create(&out, size, 40).unwrap());
            (0..3).for_each(|n| webp.add(&picture(n)).unwrap());
            webp.finish().unwrap();
            let bytes = std::fs::read(&out).unwrap();
            let mut decoder = WebPDecoder::new(std::io::Cursor::new(&bytes)).unwrap();
            assert_eq!((decoder.dimensions(), decoder.num_frames()), ((size, size), 3));
            assert_eq!((decoder.loop_count(), decoder.loop_duration()), (LoopCount::Forever, 120));
            for n in 0..3 {
                let mut read = vec![0; decoder.output_buffer_size().unwrap()];
                assert_eq!(decoder.read_frame(&mut read).unwrap(), 40);
                assert_eq!(read, picture(n), "picture {n} of {size} x {size}");
            }
        }
    }
}
