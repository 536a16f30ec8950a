! A field on a rectilinear grid, denser at the beginning of x and towards the end of z: uneven URL RANK 1.
program uneven
    use, intrinsic :: iso_fortran_env, only: real64
    use lamina
    implicit none
    integer, parameter :: n(3) = [24, 20, 16], steps = 3
    type(lamina_run) :: run
    type(lamina_connection) :: connection
    type(lamina_summary) :: summary
    real(real64) :: u(n(1), n(2), n(3))
    character(200) :: url
    integer :: step, i, j, k
    integer(kind(lamina_admitted)) :: code

    call get_command_argument(1, url)
    run%generator = trim(url)
    run%name = "uneven"
    run%field = "u"
    run%dims = n
    run%spacing = [1, 2, 1]
    run%voxel_type = lamina_f64
    run%x = [(0.125_real64 * i * i, i = 0, n(1) - 1)]
    run%z = [(-0.25_real64 * (n(3) - 1 - k)**2, k = 0, n(3) - 1)]
    call lamina_open(run, connection, code)
    if (code < 0) error stop
    do step = 0, steps - 1
        do k = 1, n(3)
            do j = 1, n(2)
                u(:, j, k) = run%x + 0.5_real64 * (j - 1) * (step + 1) - run%z(k)
            end do
        end do
        call lamina_put(connection, step, 0.1_real64 * step, [1, 1, 1], u, code)
        if (code < 0) error stop
    end do
    call lamina_end(connection, summary)
    print '(3(a, i0))', "pushed ", summary%pushed, " dropped ", summary%dropped, " lost ", summary%lost
end program
