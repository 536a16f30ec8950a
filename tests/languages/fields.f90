! A velocity beside a density, of which its magnitude is shown, in two bricks inside of ghost cells: fields URL RANK 1.
program fields
    use, intrinsic :: iso_fortran_env, only: real32, real64
    use lamina
    implicit none
    integer, parameter :: n(3) = [24, 20, 16], steps = 3, half = 7
    type(lamina_run) :: run
    type(lamina_connection) :: connection
    type(lamina_summary) :: summary
    real(real32) :: density(0:n(1) + 1, 0:n(2) + 1, 0:n(3) + 1)
    real(real64) :: v(0:n(1) + 1, 0:n(2) + 1, 0:n(3) + 1, 3)
    character(200) :: url
    integer :: step, i, j, k
    integer(kind(lamina_admitted)) :: code
    logical :: wanted

    call get_command_argument(1, url)
    run%generator = trim(url)
    run%name = "fields"
    run%field = "density"
    run%dims = n
    run%voxel_type = lamina_f32
    run%more_fields = [lamina_field("v.x", lamina_f64), lamina_field("v.y", lamina_f64), lamina_field("v.z", lamina_f64)]
    run%shown = "magnitude(v)"
    call lamina_open(run, connection, code)
    if (code < 0) error stop
    density = 1
    do step = 0, steps - 1
        call lamina_wants(connection, step, wanted, code)
        if (.not. wanted .or. code /= 1) error stop
        call lamina_diagnostic(connection, "residual", 0.5_real64 * step, code)
        if (code /= 0) error stop
        do k = 1, n(3)
            do j = 1, n(2)
                do i = 1, n(1)
                    v(i, j, k, :) = [0.25_real64 * (i - 1) + step, 0.5_real64 * (j - 1), 0.125_real64 * (k - 1) * (i - 1)]
                end do
            end do
        end do
        if (step == 0) then
            call lamina_put(connection, step, 0.1_real64 * step, [1, 1, 1], density(1:n(1), 1:n(2), 1:n(3)), code, &
                more=components(1, n(3)))
        else
            call lamina_put_bricks(connection, step, 0.1_real64 * step, &
                [lamina_box(density(1:n(1), 1:n(2), 1:half), [1, 1, 1], more=components(1, half)), &
                lamina_box(density(1:n(1), 1:n(2), half + 1:n(3)), [1, 1, half + 1], more=components(half + 1, n(3)))], code)
        end if
        if (code < 0) error stop
    end do
    call lamina_end(connection, summary)
    print '(3(a, i0))', "pushed ", summary%pushed, " dropped ", summary%dropped, " lost ", summary%lost

contains

    function components(first, last) result(boxes)
        integer, intent(in) :: first, last
        type(lamina_brick) :: boxes(3)
        integer :: c
        do c = 1, 3
            boxes(c) = lamina_box(v(1:n(1), 1:n(2), first:last, c), [1, 1, first])
        end do
    end function

end program
