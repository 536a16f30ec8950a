! Each rank knows its own bricks; rank 0 has none, rank r one of 3 r + 1 points from (6, 2 r + 1, 2) on, where indices begin at 1.
program whole_grid
    use, intrinsic :: iso_c_binding, only: c_int64_t
    use lamina_mpi
    use mpi
    implicit none
    integer :: rank, failed
    integer(c_int64_t) :: last(3, 1), dims(3)

    call MPI_Init(failed)
    call MPI_Comm_rank(MPI_COMM_WORLD, rank, failed)
    last(:, 1) = [5 + 3 * rank + 1, 2 * rank + 1, 2]
    if (rank == 0) then
        call lamina_whole_grid(MPI_COMM_WORLD, last(:, 1:0), dims)
    else
        call lamina_whole_grid(MPI_COMM_WORLD, last, dims)
    end if
    print '(i0, 1x, i0, 1x, i0)', dims
    call MPI_Finalize(failed)
end program
