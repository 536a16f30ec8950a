//! The ranks of a run, by the MPI library that the process has; none is needed where there is one rank.

use crate::symbols::{address, function};
use std::ffi::{CStr, c_int, c_void};

type CommFromFortran = unsafe extern "C" fn(c_int) -> usize;
type CommNumber = unsafe extern "C" fn(usize, *mut c_int) -> c_int;
type CommDuplicate = unsafe extern "C" fn(usize, *mut usize) -> c_int;
type Initialized = unsafe extern "C" fn(*mut c_int) -> c_int;
type Allgather = unsafe extern "C" fn(*const c_void, c_int, usize, *mut c_void, c_int, usize, usize) -> c_int;
type Alltoall = Allgather;
type Alltoallv = unsafe extern "C" fn(
    *const c_void,
    *const c_int,
    *const c_int,
    usize,
    *mut c_void,
    *const c_int,
    *const c_int,
    usize,
    usize,
) -> c_int;

/// This rank among them.
#[derive(Debug)]
pub(crate) struct Ranks {
    pub(crate) rank: u32,
    pub(crate) size: u32,
    communicator: Option<Communicator>,
}

/// Handles are pointers or `int`; both fit a register, and are passed as one.
#[derive(Debug)]
struct Communicator {
    handle: usize,
    byte: usize,
    allgather: Allgather,
    alltoall: Alltoall,
    alltoallv: Alltoallv,
}

/// `MPI_BYTE` and `MPI_COMM_WORLD` of the library that is loaded: Open MPI's are addresses, the standard's (MPI 5.0, chapter 20) and
/// MPICH's are numbers.
fn constants() -> Option<[usize; 2]> {
    if let (Some(byte), Some(world)) = (address("ompi_mpi_byte"), address("ompi_mpi_comm_world")) {
        return Some([byte as usize, world as usize]);
    }
    let call = address("MPI_Allgather")?;
    // SAFETY: zeros are a Dl_info; it is filled where the address is known.
    let mut place: libc::Dl_info = unsafe { std::mem::zeroed() };
    // SAFETY: the address is a function's.
    let known = unsafe { libc::dladdr(call, &raw mut place) } != 0 && !place.dli_fname.is_null();
    // SAFETY: a path that ends with a zero, as long as the library is loaded.
    let file = if known { unsafe { CStr::from_ptr(place.dli_fname) }.to_string_lossy() } else { "".into() };
    Some(if file.contains("mpi_abi") { [0x247, 0x101] } else { [0x4c00_010d, 0x4400_0000] })
}

impl Ranks {
    /// Those of the communicator that is `stated` as a Fortran handle; of the world, where MPI is in use; else one.
    pub(crate) fn of(stated: Option<f64>) -> Result<Self, String> {
        let alone = Self { rank: 0, size: 1, communicator: None };
        // SAFETY: the types are MPI's, handles in a register each.
        let functions = unsafe {
            (
                function::<Initialized>("MPI_Initialized"),
                function::<CommNumber>("MPI_Comm_rank"),
                function::<CommNumber>("MPI_Comm_size"),
                function::<Allgather>("MPI_Allgather"),
                function::<Alltoall>("MPI_Alltoall"),
                function::<Alltoallv>("MPI_Alltoallv"),
            )
        };
        let (Some(initialized), Some(rank), Some(size), Some(allgather), Some(alltoall), Some(alltoallv)) = functions
        else {
            return match stated {
                None => Ok(alone),
                Some(_) => Err("mpi_comm is stated, but this process has no MPI library".to_owned()),
            };
        };
        let mut is_on = 0;
        // SAFETY: allowed at any time; it writes a flag.
        unsafe { initialized(&raw mut is_on) };
        let Some([byte, world]) = constants().filter(|_| is_on != 0) else { return Ok(alone) };
        let handle = match stated {
            None => world,
            // SAFETY: MPI's types. Where there is no such function, as in MPICH, a Fortran handle is the handle.
            Some(fortran) => match unsafe {
                let of_fortran = function::<CommFromFortran>("MPI_Comm_f2c");
                of_fortran.or_else(|| function::<CommFromFortran>("MPI_Comm_fromint"))
            } {
                // SAFETY: MPI is initialized; the handle is the simulation's.
                Some(convert) => unsafe { convert(fortran as c_int) },
                None => fortran as c_int as u32 as usize,
            },
        };
        let mut numbers = [0; 2];
        // SAFETY: MPI is initialized, and the communicator is one.
        let codes = unsafe { [rank(handle, &raw mut numbers[0]), size(handle, &raw mut numbers[1])] };
        if codes != [0, 0] {
            return Err(format!("MPI_Comm_rank and MPI_Comm_size answer {codes:?}"));
        }
        let communicator = Some(Communicator { handle, byte, allgather, alltoall, alltoallv });
        Ok(Self { rank: numbers[0] as u32, size: numbers[1] as u32, communicator })
    }

    /// From now on by a communicator of its own, since the simulation may free its own. Collective: all ranks call it.
    pub(crate) fn duplicate(&mut self) -> Result<(), String> {
        let Some(communicator) = self.communicator.as_mut().filter(|_| self.size > 1) else { return Ok(()) };
        // SAFETY: the type is MPI's; a handle is a pointer or an `int`, and the place has room for either.
        let Some(duplicate) = (unsafe { function::<CommDuplicate>("MPI_Comm_dup") }) else { return Ok(()) };
        let mut own = 0_usize;
        // SAFETY: the communicator is one.
        match unsafe { duplicate(communicator.handle, &raw mut own) } {
            0 => communicator.handle = own,
            code => return Err(format!("MPI_Comm_dup answers {code}")),
        }
        Ok(())
    }

    /// Sends `parts[r]` of a step to rank r, and returns what each rank has sent here, by rank. Collective: all ranks call it, at the
    /// same step.
    pub(crate) fn exchange(&self, step: u64, parts: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, String> {
        let Some(communicator) = self.communicator.as_ref().filter(|_| self.size > 1) else {
            return Ok(parts);
        };
        // MPI counts in 31 bits: more goes in several rounds, as many as the rank with the longest part needs.
        let quota = c_int::MAX as usize / self.size as usize;
        let longest = parts.iter().map(Vec::len).max().unwrap_or(0) as u64;
        let told = communicator.gather_equal(&[step, longest].map(u64::to_le_bytes).concat(), self.size)?;
        let told = told_pairs(&told);
        same_step(step, &told)?;
        let longest = told.iter().map(|[_, longest]| *longest).max().unwrap_or(0) as usize;
        let mut received = vec![Vec::new(); self.size as usize];
        for round in 0..longest.div_ceil(quota) {
            let sent: Vec<&[u8]> = parts.iter().map(|part| part.chunks(quota).nth(round).unwrap_or_default()).collect();
            communicator.exchange_once(&sent, &mut received)?;
        }
        Ok(received)
    }

    /// True if it is so of a step at any rank. Collective: all ranks call it, at the same step.
    pub(crate) fn any(&self, step: u64, is_so: bool) -> Result<bool, String> {
        let Some(communicator) = self.communicator.as_ref().filter(|_| self.size > 1) else { return Ok(is_so) };
        let told = communicator.gather_equal(&[step, u64::from(is_so)].map(u64::to_le_bytes).concat(), self.size)?;
        let told = told_pairs(&told);
        same_step(step, &told)?;
        Ok(told.iter().any(|[_, is_so]| *is_so > 0))
    }

    /// `bytes` of every rank, by rank. Collective: all ranks call it.
    pub(crate) fn gather(&self, bytes: &[u8]) -> Result<Vec<Vec<u8>>, String> {
        let Some(communicator) = self.communicator.as_ref().filter(|_| self.size > 1) else {
            return Ok(vec![bytes.to_vec()]);
        };
        let lengths = communicator.gather_equal(&(bytes.len() as u64).to_le_bytes(), self.size)?;
        let lengths: Vec<usize> = lengths.as_chunks().0.iter().map(|b| u64::from_le_bytes(*b) as usize).collect();
        let longest = lengths.iter().copied().max().unwrap_or(0).max(1);
        let mut padded = bytes.to_vec();
        padded.resize(longest, 0);
        let all = communicator.gather_equal(&padded, self.size)?;
        Ok(all.chunks(longest).zip(lengths).map(|(part, len)| part[..len].to_vec()).collect())
    }
}

/// Two numbers of each rank.
fn told_pairs(bytes: &[u8]) -> Vec<[u64; 2]> {
    let number = |bytes: &[u8]| u64::from_le_bytes(std::array::from_fn(|n| bytes[n]));
    bytes.as_chunks::<16>().0.iter().map(|pair| [number(pair), number(&pair[8..])]).collect()
}

/// The first number of each rank is this rank's step.
fn same_step(step: u64, told: &[[u64; 2]]) -> Result<(), String> {
    let other = told.iter().find(|[other, _]| *other != step);
    other.map_or(Ok(()), |[other, _]| {
        Err(format!("ranks hand over different steps, {step} and {other}: each has to call at each step"))
    })
}

impl Communicator {
    /// Sends a part to each rank, and adds what came from each; less than 2^31 bytes in all either way.
    fn exchange_once(&self, sent: &[&[u8]], received: &mut [Vec<u8>]) -> Result<(), String> {
        let counts: Vec<c_int> = sent.iter().map(|part| part.len() as c_int).collect();
        let starts = |counts: &[c_int]| -> Vec<c_int> {
            counts.iter().scan(0, |sum, count| Some(std::mem::replace(sum, *sum + count))).collect()
        };
        let mut arriving = vec![0; counts.len()];
        let size = size_of::<c_int>() as c_int;
        let (byte, comm) = (self.byte, self.handle);
        // SAFETY: one count to and from each rank of the communicator.
        let code = unsafe {
            (self.alltoall)(counts.as_ptr().cast(), size, byte, arriving.as_mut_ptr().cast(), size, byte, comm)
        };
        if code != 0 {
            return Err(format!("MPI_Alltoall answers {code}"));
        }
        let [from, to] = [starts(&counts), starts(&arriving)];
        // One byte more than is sent: the address of nothing is 1, which is Open MPI's MPI_IN_PLACE.
        let (mut sent, mut all) = (sent.concat(), vec![0_u8; arriving.iter().sum::<c_int>() as usize + 1]);
        sent.push(0);
        let (first, place) = (sent.as_ptr().cast(), all.as_mut_ptr().cast());
        // SAFETY: both places have room for what is counted.
        let code = unsafe {
            let [sizes, arriving] = [counts.as_ptr(), arriving.as_ptr()];
            (self.alltoallv)(first, sizes, from.as_ptr(), byte, place, arriving, to.as_ptr(), byte, comm)
        };
        if code != 0 {
            return Err(format!("MPI_Alltoallv answers {code}"));
        }
        for ((part, start), count) in received.iter_mut().zip(to).zip(arriving) {
            part.extend(&all[start as usize..][..count as usize]);
        }
        Ok(())
    }

    /// As many bytes of each rank.
    fn gather_equal(&self, bytes: &[u8], ranks: u32) -> Result<Vec<u8>, String> {
        let mut all = vec![0_u8; bytes.len() * ranks as usize];
        let (count, byte) = (bytes.len() as c_int, self.byte);
        let (from, to) = (bytes.as_ptr().cast(), all.as_mut_ptr().cast());
        // SAFETY: both places have room for what is counted; the handles are MPI's own.
        match unsafe { (self.allgather)(from, count, byte, to, count, byte, self.handle) } {
            0 => Ok(all),
            code => Err(format!("MPI_Allgather answers {code}")),
        }
    }
}
