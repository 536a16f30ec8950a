! Advection and diffusion of a blob in a periodic box, on a grid of 64 x 48 x 40 cells in uneven bricks of any number of ranks, with one
! layer of ghost cells: advection [STEPS]. At its end it checks itself: mass stays, and a Fourier mode decays as the scheme says.
program advection
    use, intrinsic :: iso_fortran_env, only: real64, error_unit
    use mpi
    ! --- what watching it takes -----------------------------------------------------------------------------------------------------
    use lamina
    use lamina_mpi
    ! --------------------------------------------------------------------------------------------------------------------------------
    implicit none
    integer, parameter :: n(3) = [64, 48, 40]
    real(real64), parameter :: pi = acos(-1.0_real64), d = 1.0_real64 / 64, diffusivity = 2e-3_real64
    real(real64), parameter :: velocity(3) = [0.5_real64, 0.25_real64, 0.125_real64], dt = 0.2_real64 * d / 0.5_real64
    real(real64), allocatable, target :: u(:, :, :), v(:, :, :)
    integer :: rank, ranks, failed, steps, step, first, last, below, above
    real(real64) :: mass, mass_before, mode_before, mode_after, expected
    character(32) :: argument
    type(lamina_connection) :: connection

    call MPI_Init(failed)
    call MPI_Comm_rank(MPI_COMM_WORLD, rank, failed)
    call MPI_Comm_size(MPI_COMM_WORLD, ranks, failed)
    steps = 200
    if (command_argument_count() > 0) then
        call get_command_argument(1, argument)
        read (argument, *) steps
    end if
    ! Slabs along z; later ranks have more: rank r begins at the share (r / ranks)**1.3.
    first = edge(rank) + 1
    last = edge(rank + 1)
    below = modulo(rank - 1, ranks)
    above = modulo(rank + 1, ranks)
    allocate (u(0:n(1) + 1, 0:n(2) + 1, first - 1:last + 1), v(0:n(1) + 1, 0:n(2) + 1, first - 1:last + 1))
    call begin()
    mass_before = total()
    mode_before = mode()
    call watch_open()
    do step = 1, steps
        call exchange()
        call advance()
        if (modulo(step, 4) == 0) call watch_put(step / 4)
    end do
    call watch_close()
    mass = total()
    mode_after = mode()
    expected = mode_before * decay()**steps
    if (rank == 0) then
        print '(a, es10.2, a, 2es14.6)', "mass off by ", abs(mass / mass_before - 1), ", mode and its closed form ", &
            mode_after, expected
        if (abs(mass / mass_before - 1) > 1e-12_real64 .or. abs(mode_after / expected - 1) > 1e-9_real64) error stop "wrong"
    end if
    call MPI_Finalize(failed)

contains

    integer function edge(r)
        integer, intent(in) :: r
        edge = nint(n(3) * (real(r, real64) / ranks)**1.3_real64)
        edge = max(edge, r)
        edge = min(edge, n(3) - (ranks - r))
    end function

    subroutine begin()
        integer :: i, j, k
        real(real64) :: p(3)
        do k = first, last
            do j = 1, n(2)
                do i = 1, n(1)
                    p = [i, j, k] * d - [0.35_real64, 0.3_real64, 0.3_real64]
                    u(i, j, k) = exp(-60 * sum(p * p))
                end do
            end do
        end do
    end subroutine

    ! A step multiplies each Fourier mode by a number: that of the first mode along y, upwind and central differences.
    real(real64) function decay()
        complex(real64) :: shift
        real(real64) :: c, s
        shift = exp(cmplx(0, 2 * pi / n(2), real64))
        c = velocity(2) * dt / d
        s = diffusivity * dt / d**2
        decay = abs(1 - c * (1 - 1 / shift) + s * (shift - 2 + 1 / shift))
    end function

    ! The size of that mode.
    real(real64) function mode()
        complex(real64) :: mine, all
        integer :: j
        mine = 0
        do j = 1, n(2)
            mine = mine + sum(u(1:n(1), j, first:last)) * exp(cmplx(0, -2 * pi * (j - 1) / n(2), real64))
        end do
        call MPI_Allreduce(mine, all, 1, MPI_DOUBLE_COMPLEX, MPI_SUM, MPI_COMM_WORLD, failed)
        mode = abs(all)
    end function

    real(real64) function total()
        real(real64) :: mine
        mine = sum(u(1:n(1), 1:n(2), first:last))
        call MPI_Allreduce(mine, total, 1, MPI_DOUBLE_PRECISION, MPI_SUM, MPI_COMM_WORLD, failed)
    end function

    ! Ghost cells: along z from the neighbors, else from the other side.
    subroutine exchange()
        integer :: count
        u(0, :, :) = u(n(1), :, :)
        u(n(1) + 1, :, :) = u(1, :, :)
        u(:, 0, :) = u(:, n(2), :)
        u(:, n(2) + 1, :) = u(:, 1, :)
        count = size(u(:, :, first))
        call MPI_Sendrecv(u(:, :, last), count, MPI_DOUBLE_PRECISION, above, 1, u(:, :, first - 1), count, &
            MPI_DOUBLE_PRECISION, below, 1, MPI_COMM_WORLD, MPI_STATUS_IGNORE, failed)
        call MPI_Sendrecv(u(:, :, first), count, MPI_DOUBLE_PRECISION, below, 2, u(:, :, last + 1), count, &
            MPI_DOUBLE_PRECISION, above, 2, MPI_COMM_WORLD, MPI_STATUS_IGNORE, failed)
    end subroutine

    subroutine advance()
        integer :: i, j, k
        real(real64) :: flow, spread
        do k = first, last
            do j = 1, n(2)
                do i = 1, n(1)
                    flow = velocity(1) * (u(i, j, k) - u(i - 1, j, k)) + velocity(2) * (u(i, j, k) - u(i, j - 1, k)) &
                        + velocity(3) * (u(i, j, k) - u(i, j, k - 1))
                    spread = u(i - 1, j, k) + u(i + 1, j, k) + u(i, j - 1, k) + u(i, j + 1, k) + u(i, j, k - 1) &
                        + u(i, j, k + 1) - 6 * u(i, j, k)
                    v(i, j, k) = u(i, j, k) + dt * (diffusivity * spread / d**2 - flow / d)
                end do
            end do
        end do
        u(1:n(1), 1:n(2), first:last) = v(1:n(1), 1:n(2), first:last)
    end subroutine

    ! --- what watching it takes -----------------------------------------------------------------------------------------------------

    subroutine watch_open()
        type(lamina_run) :: run
        integer(kind(lamina_admitted)) :: code
        character(200) :: url
        call get_environment_variable("LAMINA_GENERATOR", url)
        if (len_trim(url) > 0) run%generator = trim(url)
        run%name = "advection"
        run%field = "concentration"
        run%dims = n
        run%spacing = d
        run%voxel_type = lamina_f64
        call lamina_open_mpi(MPI_COMM_WORLD, run, connection, code)
        if (code < 0 .and. rank == 0) write (error_unit, '(2a)') "not shown: ", lamina_message()
    end subroutine

    ! In two bricks, as a code with boxes has them: below and above the middle of the slab.
    subroutine watch_put(number)
        integer, intent(in) :: number
        type(lamina_brick) :: bricks(2)
        integer(kind(lamina_admitted)) :: code
        integer :: middle
        middle = (first + last) / 2
        if (middle == last) then
            call lamina_put(connection, number, number * 4 * dt, [1, 1, first], u(1:n(1), 1:n(2), first:last), code)
        else
            bricks(1) = lamina_box(u(1:n(1), 1:n(2), first:middle), [1, 1, first])
            bricks(2) = lamina_box(u(1:n(1), 1:n(2), middle + 1:last), [1, 1, middle + 1])
            call lamina_put_bricks(connection, number, number * 4 * dt, bricks, code)
        end if
        if (code < 0 .and. rank == 0) write (error_unit, '(a, i0, 2a)') "step ", number, " not shown: ", lamina_message()
    end subroutine

    subroutine watch_close()
        type(lamina_summary) :: summary
        call lamina_end(connection, summary)
        if (rank == 0) print '(3(a, i0))', "pushed ", summary%pushed, ", dropped ", summary%dropped, ", lost ", summary%lost
    end subroutine

end program
