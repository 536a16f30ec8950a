! A run of all ranks of an MPI communicator. Only this file needs MPI: compile it after lamina.f90, with mpifort.
module lamina_mpi
    use, intrinsic :: iso_c_binding, only: c_int32_t, c_int64_t
    use lamina
    use mpi
    implicit none
    private
    public :: lamina_open_mpi, lamina_whole_grid

contains

    ! As lamina_open, with rank and ranks of `comm` (of mpi_f08: comm%MPI_VAL). Each rank calls it for itself: it is not collective.
    subroutine lamina_open_mpi(comm, run, connection, code)
        integer, intent(in) :: comm
        type(lamina_run), intent(in) :: run
        type(lamina_connection), intent(out) :: connection
        integer(c_int32_t), intent(out) :: code
        type(lamina_run) :: all
        integer :: rank, ranks, failed

        all = run
        call MPI_Comm_rank(comm, rank, failed)
        call MPI_Comm_size(comm, ranks, failed)
        all%rank = rank
        all%ranks = ranks
        call lamina_open(all, connection, code)
    end subroutine

    ! The sample points of a grid that no rank knows as a whole, as of codes with boxes: `last` has the last index along x, y and z, from 1
    ! on, of each brick of this rank, which may have none. Collective: all ranks of `comm` call it, before they open the run.
    subroutine lamina_whole_grid(comm, last, dims)
        integer, intent(in) :: comm
        integer(c_int64_t), intent(in) :: last(:, :)
        integer(c_int64_t), intent(out) :: dims(3)
        integer(c_int64_t) :: own(3)
        integer :: failed

        own = max(0_c_int64_t, maxval(last, 2))
        call MPI_Allreduce(own, dims, 3, MPI_INTEGER8, MPI_MAX, comm, failed)
    end subroutine

end module
