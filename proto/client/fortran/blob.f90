! A blob that drifts, colored by its heat, pushed in slabs by 1 to 16 ranks: blob URL RANK RANKS. The fields lie inside of one
! layer of ghost cells, and are read from there.
program blob
    use, intrinsic :: iso_fortran_env, only: real64, int32, error_unit
    use lamina
    implicit none

    integer, parameter :: nx = 24, ny = 20, nz = 16, steps = 3
    real(real64), allocatable :: density(:, :, :), heat(:, :, :)
    type(lamina_run) :: run
    type(lamina_connection) :: connection
    type(lamina_summary) :: summary
    integer(int32) :: code
    logical :: shown
    integer :: rank, ranks, first, beyond, step, i, j, k
    real(real64) :: x, y, z

    if (command_argument_count() /= 3) error stop "usage: blob URL RANK RANKS"
    rank = number(2)
    ranks = number(3)
    first = nz * rank / ranks
    beyond = nz * (rank + 1) / ranks

    run%generator = argument(1)
    run%name = "blob"
    run%field = "density"
    run%dims = [nx, ny, nz]
    run%spacing = 0.1_real64
    run%origin = [-1.2_real64, -1.0_real64, -0.8_real64]
    run%voxel_type = lamina_f64
    run%color_field = "heat"
    run%color_type = lamina_f64
    run%rank = rank
    run%ranks = ranks
    call lamina_open(run, connection, code)
    shown = code >= 0
    if (.not. shown) write (error_unit, *) "not shown: ", lamina_message()

    allocate (density(0:nx + 1, 0:ny + 1, 0:beyond - first + 1))
    allocate (heat, mold=density)
    do step = 0, steps - 1
        do k = first, beyond - 1
            do j = 0, ny - 1
                do i = 0, nx - 1
                    x = 0.1_real64 * i - 0.8_real64 - 0.2_real64 * step
                    y = 0.1_real64 * j - 1.0_real64
                    z = 0.1_real64 * k - 0.8_real64
                    density(i + 1, j + 1, k - first + 1) = 1 / (1 + 9 * (x * x + y * y + z * z))
                    heat(i + 1, j + 1, k - first + 1) = x + step
                end do
            end do
        end do
        if (.not. shown) cycle ! The simulation goes on, unseen.
        call lamina_put(connection, step, 0.1_real64 * step, [1, 1, first + 1], &
            density(1:nx, 1:ny, 1:beyond - first), code, heat(1:nx, 1:ny, 1:beyond - first))
        if (code < 0) write (error_unit, *) "step", step, "not shown: ", lamina_message()
    end do
    call lamina_end(connection, summary)
    print '("pushed ", i0, " dropped ", i0, " lost ", i0)', summary%pushed, summary%dropped, summary%lost

contains

    function argument(n) result(words)
        integer, intent(in) :: n
        character(:), allocatable :: words
        integer :: length
        call get_command_argument(n, length=length)
        allocate (character(length) :: words)
        call get_command_argument(n, words)
    end function

    integer function number(n)
        integer, intent(in) :: n
        character(:), allocatable :: words
        words = argument(n)
        read (words, *) number
    end function

end program
