//! The daemon beside the viewer: VDIs in, pictures and PSNR out.
