! Says what people ask for, until they ask for the end: steered URL.
program steered
    use, intrinsic :: iso_c_binding
    use lamina
    implicit none
    type(lamina_run) :: run
    type(lamina_connection) :: connection
    type(lamina_summary) :: summary
    character(256) :: url
    real(c_float) :: values(8, 8, 8) = 0
    integer(c_int32_t) :: code, what
    integer :: step, number
    real(c_double) :: value
    logical :: paused

    call get_command_argument(1, url)
    run%generator = trim(url)
    run%name = "steered"
    run%field = "f"
    run%dims = 8
    run%voxel_type = lamina_f32
    run%steering = .true.
    run%numbers = [lamina_number("inflow", 1d0, 0d0, 2d0), lamina_number("angle", 0d0, -90d0, 90d0)]
    call lamina_open(run, connection, code)
    if (code < 0) error stop 1
    what = lamina_nothing
    paused = .false.
    do step = 0, 6000
        if (.not. paused) call lamina_put(connection, step, 0d0, [1, 1, 1], values, code)
        call execute_command_line("sleep 0.01")
        do
            call lamina_steering(connection, what, number, value)
            if (what <= 0) exit
            select case (what)
            case (lamina_set)
                print "(a, ' = ', f0.2)", trim(run%numbers(number)%name), value
            case (lamina_pause)
                print "(a)", "pause"
                paused = .true.
            case (lamina_resume)
                print "(a)", "resume"
                paused = .false.
            case (lamina_stop)
                print "(a)", "stop"
                call lamina_end(connection, summary)
                stop
            end select
        end do
    end do
    error stop 3
end program
