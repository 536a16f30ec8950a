! The blob of proto/client/fortran/blob.f90 by one rank, computed into the node's own memory: buffers URL.
program buffers
    use, intrinsic :: iso_fortran_env, only: real64
    use lamina
    implicit none
    integer, parameter :: n(3) = [24, 20, 16], steps = 3
    type(lamina_run) :: run
    type(lamina_connection) :: connection
    type(lamina_summary) :: summary
    real(real64), pointer :: density(:, :, :), heat(:, :, :)
    real(real64) :: x, y, z
    character(200) :: url
    integer :: step, i, j, k
    integer(kind(lamina_admitted)) :: code

    call get_command_argument(1, url)
    run%generator = trim(url)
    run%name = "blob"
    run%field = "density"
    run%dims = n
    run%spacing = 0.1_real64
    run%origin = [-1.2_real64, -1.0_real64, -0.8_real64]
    run%voxel_type = lamina_f64
    run%color_field = "heat"
    run%color_type = lamina_f64
    call lamina_open(run, connection, code)
    if (code < 0) error stop
    do step = 0, steps - 1
        call lamina_buffer(connection, n, density, code, heat)
        if (code < 0) error stop
        do k = 1, n(3)
            do j = 1, n(2)
                do i = 1, n(1)
                    x = 0.1_real64 * (i - 1) - 0.8_real64 - 0.2_real64 * step
                    y = 0.1_real64 * (j - 1) - 1.0_real64
                    z = 0.1_real64 * (k - 1) - 0.8_real64
                    density(i, j, k) = 1 / (1 + 9 * (x * x + y * y + z * z))
                    heat(i, j, k) = x + step
                end do
            end do
        end do
        call lamina_put(connection, step, 0.1_real64 * step, [1, 1, 1], density, code, heat)
        if (code < 0) error stop
    end do
    call lamina_end(connection, summary)
    print '(3(a, i0))', "pushed ", summary%pushed, " dropped ", summary%dropped, " lost ", summary%lost
end program
