! Opens a run of all ranks of an MPI communicator. Only this file needs MPI: compile it after lamina.f90, with mpifort.
module lamina_mpi
    use, intrinsic :: iso_c_binding, only: c_int32_t
    use lamina
    use mpi
    implicit none
    private
    public :: lamina_open_mpi

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

end module
