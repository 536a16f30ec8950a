! What a simulation in Fortran links to hand its time steps to a Lamina generator-node; lamina.h has what every function means.
!
!     gfortran proto/client/fortran/lamina.f90 simulation.f90 -Ltarget/release -llamina_c -Wl,-rpath,$PWD/target/release
!
! Arrays may be sections, forwards: rho(1:nx, 1:ny, 1:nz) without its ghost cells is read where it is, not copied. One thread at
! a time may use a connection: call it outside of parallel regions.
module lamina
    use, intrinsic :: iso_c_binding
    implicit none
    private
    public :: lamina_number, lamina_steering, lamina_field
    public :: lamina_run, lamina_connection, lamina_summary, lamina_open, lamina_put, lamina_buffer, &
        lamina_wants, lamina_diagnostic, lamina_box, lamina_brick, lamina_put_bricks, lamina_end, lamina_message

    integer(c_int32_t), parameter, public :: lamina_f32 = 5, lamina_f64 = 6
    integer(c_int32_t), parameter, public :: lamina_drop_oldest = 0, lamina_drop_newest = 1, lamina_block = 2
    integer(c_int32_t), parameter, public :: lamina_admitted = 0, lamina_dropped = 1, lamina_invalid = -1, &
        lamina_refused = -2, lamina_unreachable = -3, lamina_deadline = -4, lamina_failed = -5

    ! What people who watch ask for.
    integer(c_int32_t), parameter, public :: lamina_nothing = 0, lamina_pause = 1, &
        lamina_resume = 2, lamina_stop = 3, lamina_set = 4

    ! A number that people may change: what they see it called, its value and the range of values.
    type :: lamina_number
        character(63) :: name = ''
        real(c_double) :: value = 0, least = 0, most = 0
    end type

    ! A further field: its name, and the type of its voxels.
    type :: lamina_field
        character(200) :: name = ''
        integer(c_int32_t) :: voxel_type = 0
    end type

    ! A run; dims, name, field and voxel_type are to be stated. Where rank and ranks are 0 they are as the MPI launcher's environment
    ! says, else one rank.
    type :: lamina_run
        character(:), allocatable :: generator, name, field, color_field, credentials, shown
        integer(c_int64_t) :: dims(3) = 0
        real(c_double) :: spacing(3) = 1, origin(3) = 0
        integer(c_int32_t) :: voxel_type = 0, color_type = 0
        integer(c_int32_t) :: rank = 0, ranks = 0, full_policy = lamina_drop_oldest
        real(c_double) :: deadline_secs = 5
        ! People may ask to pause, to go on, to stop and to change these numbers: lamina_steering.
        logical :: steering = .false.
        type(lamina_number), allocatable :: numbers(:)
        ! Every brick carries these, too; `shown` may be an expression over them, such as magnitude(v), which has v.x, v.y and v.z.
        type(lamina_field), allocatable :: more_fields(:)
        ! Positions of the sample points of axes that are not evenly spaced, ascending: dims are as many, and steps are shown on as many
        ! even ones.
        real(c_double), allocatable :: x(:), y(:), z(:)
    end type

    type :: lamina_connection
        private
        type(c_ptr) :: client = c_null_ptr
    end type

    type, bind(c) :: lamina_summary
        integer(c_int64_t) :: pushed = 0, dropped = 0, lost = 0, run_dropped_steps = -1
    end type

    type, bind(c) :: options
        type(c_ptr) :: generator, name, field
        integer(c_int64_t) :: dims(3)
        real(c_double) :: spacing(3), origin(3)
        integer(c_int32_t) :: voxel_type, color_type
        type(c_ptr) :: color_field
        integer(c_int32_t) :: rank, ranks, full_policy
        real(c_double) :: deadline_secs
        type(c_ptr) :: credentials
        integer(c_int32_t) :: steering, number_count
        type(c_ptr) :: numbers, more_fields
        integer(c_int32_t) :: more_field_count
        type(c_ptr) :: shown
        type(c_ptr) :: coordinates(3)
    end type

    type, bind(c) :: c_field
        type(c_ptr) :: name
        integer(c_int32_t) :: voxel_type
    end type

    type, bind(c) :: c_array
        type(c_ptr) :: voxels
        integer(c_int32_t) :: voxel_type
    end type

    type, bind(c) :: c_number
        type(c_ptr) :: name
        real(c_double) :: value, least, most
    end type

    type, bind(c) :: c_request
        integer(c_int32_t) :: what, number
        real(c_double) :: value
        character(kind=c_char) :: asked_by(64)
    end type

    type, bind(c) :: c_brick
        integer(c_int64_t) :: start(3), dims(3), strides(3)
        type(c_ptr) :: voxels, colors
        integer(c_int32_t) :: voxel_type = 0, color_type = 0
        type(c_ptr) :: more = c_null_ptr
    end type

    ! Where a brick lies in memory.
    type :: lamina_brick
        private
        type(c_brick) :: place
        type(c_array), allocatable :: more(:)
    end type

    interface
        function c_connect(run, length, client) bind(c, name="lamina_connect_sized") result(code)
            import :: c_ptr, c_int32_t, c_size_t, options
            type(options), intent(in) :: run
            integer(c_size_t), value :: length
            type(c_ptr), intent(out) :: client
            integer(c_int32_t) :: code
        end function
        function c_wants(client, step) bind(c, name="lamina_wants") result(code)
            import :: c_ptr, c_int32_t, c_int64_t
            type(c_ptr), value :: client
            integer(c_int64_t), value :: step
            integer(c_int32_t) :: code
        end function
        function c_diagnostic(client, name, value) bind(c, name="lamina_diagnostic") result(code)
            import :: c_ptr, c_int32_t, c_char, c_double
            type(c_ptr), value :: client
            character(kind=c_char), intent(in) :: name(*)
            real(c_double), value :: value
            integer(c_int32_t) :: code
        end function
        function c_push(client, step, time, given) bind(c, name="lamina_push") result(code)
            import :: c_ptr, c_int32_t, c_int64_t, c_double, c_brick
            type(c_ptr), value :: client
            integer(c_int64_t), value :: step
            real(c_double), value :: time
            type(c_brick), intent(in) :: given
            integer(c_int32_t) :: code
        end function
        function c_push_bricks(client, step, time, given, count) bind(c, name="lamina_push_bricks") result(code)
            import :: c_ptr, c_int32_t, c_int64_t, c_double, c_size_t, c_brick
            type(c_ptr), value :: client
            integer(c_int64_t), value :: step
            real(c_double), value :: time
            type(c_brick), intent(in) :: given(*)
            integer(c_size_t), value :: count
            integer(c_int32_t) :: code
        end function
        function c_buffer(client, dims, voxels, colors, more) bind(c, name="lamina_buffer") result(code)
            import :: c_ptr, c_int32_t, c_int64_t
            type(c_ptr), value :: client
            integer(c_int64_t), intent(in) :: dims(3)
            type(c_ptr), intent(out) :: voxels, colors
            type(c_ptr), intent(inout), optional :: more(*)
            integer(c_int32_t) :: code
        end function
        function c_steering(client, request) bind(c, name="lamina_steering") result(code)
            import :: c_ptr, c_int32_t, c_request
            type(c_ptr), value :: client
            type(c_request), intent(out) :: request
            integer(c_int32_t) :: code
        end function
        subroutine c_close(client, summary) bind(c, name="lamina_close")
            import :: c_ptr, lamina_summary
            type(c_ptr), value :: client
            type(lamina_summary), intent(out) :: summary
        end subroutine
        function c_error() bind(c, name="lamina_error") result(words)
            import :: c_ptr
            type(c_ptr) :: words
        end function
        function c_strlen(words) bind(c, name="strlen") result(n)
            import :: c_ptr, c_size_t
            type(c_ptr), value :: words
            integer(c_size_t) :: n
        end function
    end interface

    ! call lamina_put(connection, step, time, first, values, code [, colors, more]): this rank's part of the step, whose first sample
    ! point has the indices `first`, counted from 1, in the run's grid; colors, of the second field, lie in memory as the
    ! values do, and so do the further fields: more=[lamina_box(u, first), lamina_box(v, first)], in the order of the run's more_fields.
    ! The code is one of those above; the simulation may go on in any case.
    interface lamina_put
        module procedure put_f32, put_f64
    end interface

    ! lamina_box(values, first [, colors, more]): a brick as lamina_put takes it, for call lamina_put_bricks(connection, step, time, bricks,
    ! code), which hands over several of this rank, or none.
    interface lamina_box
        module procedure box_f32, box_f64
    end interface

    ! call lamina_buffer(connection, n, values, code [, colors, more]): pointers to arrays of n(1) x n(2) x n(3) to compute into, which
    ! a node on the same host reads where they are; more(:) gets the addresses of the further fields', for c_f_pointer. Each is for
    ! one lamina_put, and not to be used after it.
    interface lamina_buffer
        module procedure buffer_f32, buffer_f64
    end interface

contains

    ! Opens a run. The code is below 0 if it cannot be right or the node refuses it; lamina_message() says why.
    subroutine lamina_open(run, connection, code)
        type(lamina_run), intent(in) :: run
        type(lamina_connection), intent(out) :: connection
        integer(c_int32_t), intent(out) :: code
        character(kind=c_char, len=:), allocatable, target :: generator, name, field, color_field, credentials, shown
        character(kind=c_char, len=201), allocatable, target :: field_names(:)
        type(c_field), allocatable, target :: fields(:)
        real(c_double), allocatable, target :: x(:), y(:), z(:)
        character(kind=c_char, len=64), allocatable, target :: names(:)
        type(c_number), allocatable, target :: numbers(:)
        type(options) :: o
        integer :: n, i

        o%generator = text(run%generator, generator)
        o%name = text(run%name, name)
        o%field = text(run%field, field)
        o%color_field = text(run%color_field, color_field)
        o%dims = run%dims
        o%spacing = run%spacing
        o%origin = run%origin
        o%voxel_type = run%voxel_type
        o%color_type = run%color_type
        o%rank = run%rank
        o%ranks = run%ranks
        o%full_policy = run%full_policy
        o%deadline_secs = run%deadline_secs
        o%credentials = text(run%credentials, credentials)
        o%steering = merge(1, 0, run%steering)
        n = 0
        if (allocated(run%numbers)) n = size(run%numbers)
        allocate (names(n), numbers(n))
        do i = 1, n
            names(i) = trim(run%numbers(i)%name) // c_null_char
            numbers(i) = c_number(c_loc(names(i)), run%numbers(i)%value, run%numbers(i)%least, run%numbers(i)%most)
        end do
        o%number_count = n
        o%numbers = c_null_ptr
        if (n > 0) o%numbers = c_loc(numbers)
        n = 0
        if (allocated(run%more_fields)) n = size(run%more_fields)
        allocate (field_names(n), fields(n))
        do i = 1, n
            field_names(i) = trim(run%more_fields(i)%name) // c_null_char
            fields(i) = c_field(c_loc(field_names(i)), run%more_fields(i)%voxel_type)
        end do
        o%more_field_count = n
        o%more_fields = c_null_ptr
        if (n > 0) o%more_fields = c_loc(fields)
        o%shown = text(run%shown, shown)
        o%coordinates = c_null_ptr
        if (allocated(run%x)) call along(1, run%x, x)
        if (allocated(run%y)) call along(2, run%y, y)
        if (allocated(run%z)) call along(3, run%z, z)
        code = c_connect(o, c_sizeof(o), connection%client)

    contains

        ! An axis at the positions that `kept` has.
        subroutine along(axis, positions, kept)
            integer, intent(in) :: axis
            real(c_double), intent(in) :: positions(:)
            real(c_double), allocatable, target, intent(out) :: kept(:)
            kept = positions
            o%dims(axis) = size(kept)
            o%coordinates(axis) = c_loc(kept)
        end subroutine
    end subroutine

    ! The address of `from` with a zero behind it, kept in `kept`; null if it is not stated.
    function text(from, kept) result(address)
        character(:), allocatable, intent(in) :: from
        character(kind=c_char, len=:), allocatable, target, intent(out) :: kept
        type(c_ptr) :: address
        address = c_null_ptr
        if (.not. allocated(from)) return
        kept = trim(from) // c_null_char
        address = c_loc(kept)
    end function

    subroutine buffer_f32(connection, n, values, code, colors, more)
        type(lamina_connection), intent(in) :: connection
        integer, intent(in) :: n(3)
        real(c_float), pointer, intent(out) :: values(:, :, :)
        integer(c_int32_t), intent(out) :: code
        real(c_float), pointer, intent(out), optional :: colors(:, :, :)
        type(c_ptr), intent(inout), optional :: more(:)
        type(c_ptr) :: first, second

        nullify (values)
        code = c_buffer(connection%client, int(n, c_int64_t), first, second, more)
        if (code == 0) call c_f_pointer(first, values, n)
        if (code == 0 .and. present(colors)) call c_f_pointer(second, colors, n)
    end subroutine

    subroutine buffer_f64(connection, n, values, code, colors, more)
        type(lamina_connection), intent(in) :: connection
        integer, intent(in) :: n(3)
        real(c_double), pointer, intent(out) :: values(:, :, :)
        integer(c_int32_t), intent(out) :: code
        real(c_double), pointer, intent(out), optional :: colors(:, :, :)
        type(c_ptr), intent(inout), optional :: more(:)
        type(c_ptr) :: first, second

        nullify (values)
        code = c_buffer(connection%client, int(n, c_int64_t), first, second, more)
        if (code == 0) call c_f_pointer(first, values, n)
        if (code == 0 .and. present(colors)) call c_f_pointer(second, colors, n)
    end subroutine

    subroutine put_f32(connection, step, time, first, values, code, colors, more)
        type(lamina_connection), intent(in) :: connection
        integer, intent(in) :: step, first(3)
        real(c_double), intent(in) :: time
        real(c_float), intent(in), target :: values(:, :, :)
        integer(c_int32_t), intent(out) :: code
        real(c_float), intent(in), target, optional :: colors(:, :, :)
        type(lamina_brick), intent(in), optional :: more(:)
        type(lamina_brick), target :: given

        given = box_f32(values, first, colors, more)
        code = c_push(connection%client, int(step, c_int64_t), time, placed(given))
    end subroutine

    function box_f32(values, first, colors, more) result(given)
        real(c_float), intent(in), target :: values(:, :, :)
        integer, intent(in) :: first(3)
        real(c_float), intent(in), target, optional :: colors(:, :, :)
        type(lamina_brick), intent(in), optional :: more(:)
        type(lamina_brick) :: given

        given%place = place_f32(values, first)
        given%place%voxel_type = lamina_f32
        if (present(colors)) call add_colors(given%place, place_f32(colors, first), lamina_f32)
        if (present(more)) given%more = laid_out_as(given%place, more)
    end function

    ! Where an array lies.
    function place_f32(values, first) result(given)
        real(c_float), intent(in), target :: values(:, :, :)
        integer, intent(in) :: first(3)
        type(c_brick) :: given
        integer :: n(3)

        n = shape(values)
        given%start = first - 1
        given%dims = n
        given%voxels = c_null_ptr
        given%colors = c_null_ptr
        given%strides = 1
        if (any(n == 0)) return
        given%voxels = c_loc(values(1, 1, 1))
        if (n(1) > 1) given%strides(1) = apart(given%voxels, c_loc(values(2, 1, 1)), c_sizeof(values(1, 1, 1)))
        if (n(2) > 1) given%strides(2) = apart(given%voxels, c_loc(values(1, 2, 1)), c_sizeof(values(1, 1, 1)))
        if (n(3) > 1) given%strides(3) = apart(given%voxels, c_loc(values(1, 1, 2)), c_sizeof(values(1, 1, 1)))
    end function

    subroutine put_f64(connection, step, time, first, values, code, colors, more)
        type(lamina_connection), intent(in) :: connection
        integer, intent(in) :: step, first(3)
        real(c_double), intent(in) :: time
        real(c_double), intent(in), target :: values(:, :, :)
        integer(c_int32_t), intent(out) :: code
        real(c_double), intent(in), target, optional :: colors(:, :, :)
        type(lamina_brick), intent(in), optional :: more(:)
        type(lamina_brick), target :: given

        given = box_f64(values, first, colors, more)
        code = c_push(connection%client, int(step, c_int64_t), time, placed(given))
    end subroutine

    function box_f64(values, first, colors, more) result(given)
        real(c_double), intent(in), target :: values(:, :, :)
        integer, intent(in) :: first(3)
        real(c_double), intent(in), target, optional :: colors(:, :, :)
        type(lamina_brick), intent(in), optional :: more(:)
        type(lamina_brick) :: given

        given%place = place_f64(values, first)
        given%place%voxel_type = lamina_f64
        if (present(colors)) call add_colors(given%place, place_f64(colors, first), lamina_f64)
        if (present(more)) given%more = laid_out_as(given%place, more)
    end function

    ! Where an array lies.
    function place_f64(values, first) result(given)
        real(c_double), intent(in), target :: values(:, :, :)
        integer, intent(in) :: first(3)
        type(c_brick) :: given
        integer :: n(3)

        n = shape(values)
        given%start = first - 1
        given%dims = n
        given%voxels = c_null_ptr
        given%colors = c_null_ptr
        given%strides = 1
        if (any(n == 0)) return
        given%voxels = c_loc(values(1, 1, 1))
        if (n(1) > 1) given%strides(1) = apart(given%voxels, c_loc(values(2, 1, 1)), c_sizeof(values(1, 1, 1)))
        if (n(2) > 1) given%strides(2) = apart(given%voxels, c_loc(values(1, 2, 1)), c_sizeof(values(1, 1, 1)))
        if (n(3) > 1) given%strides(3) = apart(given%voxels, c_loc(values(1, 1, 2)), c_sizeof(values(1, 1, 1)))
    end function

    ! Several bricks of this rank, or none.
    subroutine lamina_put_bricks(connection, step, time, bricks, code)
        type(lamina_connection), intent(in) :: connection
        integer, intent(in) :: step
        real(c_double), intent(in) :: time
        type(lamina_brick), intent(in), target :: bricks(:)
        integer(c_int32_t), intent(out) :: code
        type(c_brick), allocatable :: places(:)
        integer :: i

        allocate (places(size(bricks)))
        do i = 1, size(bricks)
            places(i) = placed(bricks(i))
        end do
        code = c_push_bricks(connection%client, int(step, c_int64_t), time, places, size(bricks, kind=c_size_t))
    end subroutine

    ! How many voxels lie between two addresses.
    function apart(a, b, bytes) result(n)
        type(c_ptr), intent(in) :: a, b
        integer(c_size_t), intent(in) :: bytes
        integer(c_int64_t) :: n
        n = (transfer(b, 0_c_intptr_t) - transfer(a, 0_c_intptr_t)) / int(bytes, c_int64_t)
    end function

    ! Colors laid out otherwise than the values are none: NULL with a type is refused.
    subroutine add_colors(given, colors, color_type)
        type(c_brick), intent(inout) :: given
        type(c_brick), intent(in) :: colors
        integer(c_int32_t), intent(in) :: color_type
        given%color_type = color_type
        if (all(given%dims == colors%dims) .and. all(given%strides == colors%strides)) given%colors = colors%voxels
    end subroutine

    ! The arrays of further fields; those laid out otherwise than the values are NULL, which is refused.
    function laid_out_as(given, more) result(arrays)
        type(c_brick), intent(in) :: given
        type(lamina_brick), intent(in) :: more(:)
        type(c_array) :: arrays(size(more))
        integer :: i

        do i = 1, size(more)
            arrays(i) = c_array(c_null_ptr, more(i)%place%voxel_type)
            if (any(given%dims /= more(i)%place%dims) .or. any(given%strides /= more(i)%place%strides)) cycle
            arrays(i)%voxels = more(i)%place%voxels
        end do
    end function

    ! A brick as C reads it, as long as `given` is there.
    function placed(given) result(place)
        type(lamina_brick), intent(in), target :: given
        type(c_brick) :: place

        place = given%place
        if (.not. allocated(given%more)) return
        if (size(given%more) > 0) place%more = c_loc(given%more)
    end function

    ! The oldest request not given out yet: lamina_nothing if there is none, or below 0 an error. At once; to be called between steps
    ! until there is none. Of lamina_set: which of the run's numbers, from 1, and its new value. A pause whose node is lost is ended
    ! by a lamina_resume.
    subroutine lamina_steering(connection, what, number, value)
        type(lamina_connection), intent(in) :: connection
        integer(c_int32_t), intent(out) :: what
        integer, intent(out) :: number
        real(c_double), intent(out) :: value
        type(c_request) :: request
        what = c_steering(connection%client, request)
        number = request%number + 1
        value = request%value
    end subroutine

    ! Whether to compute and push a step: to be asked where its values cost something to have, once a step; what is done between this
    ! and lamina_put counts as a cost of watching. Not wanted: the node goes without the step, because a contract limits that cost, or,
    ! if the code is below 0, it is lost; it is not to be pushed. Ranks need not get the same answer: where all have a part in computing
    ! the values, let them wait for each other first, then ask, then agree (MPI_Allreduce with MPI_LOR).
    subroutine lamina_wants(connection, step, wanted, code)
        type(lamina_connection), intent(in) :: connection
        integer, intent(in) :: step
        logical, intent(out) :: wanted
        integer(c_int32_t), intent(out) :: code
        code = c_wants(connection%client, int(step, c_int64_t))
        wanted = code > 0
    end subroutine

    ! Tells a number of the step that is put next, such as a residual or an energy: it is shown and recorded beside the field, and
    ! triggers and alerts can depend on it. The name has 1 to 60 letters, digits and _, a letter first; a step has at most 64.
    subroutine lamina_diagnostic(connection, name, value, code)
        type(lamina_connection), intent(in) :: connection
        character(*), intent(in) :: name
        real(c_double), intent(in) :: value
        integer(c_int32_t), intent(out) :: code
        code = c_diagnostic(connection%client, trim(name) // c_null_char, value)
    end subroutine

    ! Ends this rank's part of the run.
    subroutine lamina_end(connection, summary)
        type(lamina_connection), intent(inout) :: connection
        type(lamina_summary), intent(out) :: summary
        if (.not. c_associated(connection%client)) return
        call c_close(connection%client, summary)
        connection%client = c_null_ptr
    end subroutine

    ! Why the last call failed.
    function lamina_message() result(words)
        character(:), allocatable :: words
        character(kind=c_char), pointer :: letters(:)
        type(c_ptr) :: address
        integer :: n, i
        address = c_error()
        n = int(c_strlen(address))
        call c_f_pointer(address, letters, [n])
        allocate (character(n) :: words)
        do i = 1, n
            words(i:i) = letters(i)
        end do
    end function

end module
